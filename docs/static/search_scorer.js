// Pages of tasks, and of what programs import, come before the modules of the mechanics.
// A `var`, since the script of the theme declares the same name again.
const INTERNAL = ['api/mechanics', '_modules/'];
var Scorer = {
  score: ([docname, title, anchor, description, score]) =>
    INTERNAL.some((start) => docname.startsWith(start)) ? score - 100 : score,
  objNameMatch: 11,
  objPartialMatch: 6,
  objPrio: {0: 15, 1: 5, 2: -5},
  objPrioDefault: 0,
  title: 15,
  partialTitle: 7,
  term: 5,
  partialTerm: 2,
};
