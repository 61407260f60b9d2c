/*
 * A random feed of messages for message_loop.c, to be built with a sanitizer.
 *
 * The main thread does what Python does: it changes plans, frees those that are not in use,
 * and reads reports. The middleware returns messages of right and wrong contents, each in
 * memory of its own size, and fails now and then. A plan's rules write one number, which is
 * the plan's own, into all torques: every message and every report must have one alone.
 */

#include <pthread.h>
#include <stdio.h>
#include <stdlib.h>
#include <time.h>

#include "message_loop.c"

enum { JOINTS = 5, PATH = 20, TAU = 10, SLOTS = 16, LARGEST = 96, PLANS = 3000, FEWEST = 100 };
enum { LAYOUT_A = 60, LAYOUT_B = 100, NUMBERS = 8, GUARD_LENGTH = 52, GUARD_AT = 12 };

typedef struct {
  plan plan;
  layout layouts[2];
  motion motion;
  uint8_t bytes[2][2][LAYOUT_B], replay[LAYOUT_A];
  int64_t offsets[NUMBERS], places[NUMBERS];
  double constants[NUMBERS], row[12], settings[2], times[2], ratios[3], rows[9];
  void *tables[12][6];
} whole_plan;

static block loop;
static event now;
static double path[PATH], result[PATH], state[NUMBERS], guard_numbers[4], outputs_of[3][JOINTS];
static uint8_t ring[SLOTS * (sizeof(slot) + PATH * sizeof(double) + LARGEST)];
static uint8_t kept[LARGEST], stamps[2][8];
static int64_t information[3][INFORMATION_SIZE];
static message taken[3];
static output outputs[2];
static int rule_counts[] = {4, 9, 12};  /* without closed loops, without torque_guard, all */
static long answered, published, zeros, refuses_at = -1, kinds[4];

static void check(bool right, const char *what)
{
  if (!right) {
    fprintf(stderr, "wrong: %s\n", what);
    exit(1);
  }
}

/* Numbers of the thread of the loop alone. */
static uint32_t drawn(uint32_t below)
{
  static uint64_t seed = 88172645463325252u;
  seed ^= seed << 13, seed ^= seed >> 7, seed ^= seed << 17;
  return (uint32_t)(seed >> 32) % below;
}

static bool are_equal(const double *tau)
{
  for (int k = 1; k < JOINTS; k++)
    if (tau[k] != tau[0])
      return false;
  return true;
}

/* A rule: result from path, with a reason and the torque of the plan. */
static void next(void **table, uint32_t reasons)
{
  const double *settings = table[4];
  double *to = table[5];
  memcpy(to, table[0], sizeof path);
  path_head *head = (path_head *)to;
  head->reason = reasons ? drawn(reasons) : 0;
  head->publish = drawn(3) > 0;
  head->request = drawn(5) ? -1.0 : 3.0;
  head->retries = drawn(2);
  head->searching = 0.0;
  for (int k = 0; k < JOINTS; k++)
    to[TAU + k] = settings[0];
}

static void judge(void **table) { next(table, 4); }

static void sure(void **table) { next(table, 0); }

static void begin_search(void **table)
{
  next(table, 0);
  ((path_head *)table[5])->searching = 1.0;
}

static void go_on(void **table)
{
  next(table, 0);
  ((path_head *)table[5])->searching = drawn(4) > 0;
}

static void answer(void **table)
{
  const double *row = table[ROW_PLACE];
  next(table, drawn(8) ? 0 : 3);
  ((double *)table[5])[PATH - 1] = row[0] + ((double *)table[2])[NUMBERS - 1];
  answered++;
}

static void elapse(void **table)
{
  next(table, 0);
  ((path_head *)table[5])->drops += drawn(16) == 0;
}

/* ------------------------------------------------------------------- the middleware */

static int32_t nothing(void *set) { return set == NULL; }

static int32_t added(void *set, void *handle, void *index)
{
  return set == NULL || handle == NULL || index != NULL;
}

static int32_t waited(void *set, int64_t timeout)
{
  return set == NULL || timeout < 1 ? 1 : drawn(2) ? TIMED_OUT : 0;
}

static int32_t system_clock(void *clock, int64_t *time)
{
  static int64_t passed = SECOND;
  (void)clock;
  return (int32_t)(*time = passed += drawn(1000), 0);
}

static int32_t steady_clock(int32_t kind, int64_t *seconds)
{
  struct timespec time;
  clock_gettime(kind, &time);
  seconds[0] = time.tv_sec, seconds[1] = time.tv_nsec;
  return 0;
}

static int32_t rested(uint32_t microseconds) { return microseconds == 0; }

static int32_t take_drawn(void *subscription, void *to, void *info, void *heap)
{
  message *m = to;
  static const int64_t lengths[] = {LAYOUT_A, LAYOUT_B, GUARD_LENGTH, CLOCK_LENGTH, 0, 11, 300};
  check(subscription != NULL && heap == NULL, "arguments of take");
  if (drawn(3) == 0)
    return drawn(20) ? NOTHING_TAKEN : 1;
  free(m->data);
  m->length = lengths[drawn(7)];
  m->data = malloc((size_t)m->length);
  check(m->data != NULL || m->length == 0, "memory");
  int64_t begin = m->length && drawn(4) ? m->length : 0;  /* mostly the bytes of a layout */
  for (int64_t k = 0; k < m->length; k++)
    m->data[k] = k < begin ? 0 : (uint8_t)drawn(256);
  if (begin)
    m->data[1] = LITTLE_ENDIAN_CDR;
  ((int64_t *)info)[RECEIVED_AT] = drawn(3) * (int64_t)SECOND;
  ((int64_t *)info)[SEQUENCE_AT]++;
  return 0;
}

static int32_t publish_checked(void *publisher, void *sent, void *heap)
{
  int place = *(int *)publisher;
  check(sent == &taken[place] && heap == NULL, "arguments of publish");
  if (place < 2) {
    check(are_equal(outputs_of[place]), "torques of one plan in a message");
    zeros = outputs_of[place][0] == 0.0 ? zeros + 1 : 0;
  }
  return ++published == refuses_at ? 77 : 0;
}

/* ---------------------------------------------------------------------- what Python does */

static plan *new_plan(int64_t number)
{
  whole_plan *w = calloc(1, sizeof *w);
  check(w != NULL, "memory");
  rule_function *rules[12] = {judge, answer, sure, elapse, begin_search, go_on, begin_search, go_on,
                              sure, judge, judge, sure};
  rule *to = &w->plan.judge;
  int last = rule_counts[number % 3];
  for (int k = 0; k < last; k++) {
    void *table[] = {path, &now, state, w->row, w->settings, result};
    memcpy(w->tables[k], table, sizeof table);
    to[k] = (rule){rules[k], w->tables[k]};
  }
  w->settings[0] = (double)number;
  for (int k = 0; k < NUMBERS; k++) {
    w->offsets[k] = MESSAGE_AT + 6 * k;
    w->places[k] = NUMBERS - 1 - k;
  }
  for (int k = 0; k < 2; k++) {
    uint8_t *mask = w->bytes[k][0];
    memset(mask, 255, LAYOUT_B);
    w->bytes[k][1][1] = LITTLE_ENDIAN_CDR;
    memset(mask + MESSAGE_AT, 0, 52);
    w->layouts[k] = (layout){k ? LAYOUT_B : LAYOUT_A, mask, w->bytes[k][1], NUMBERS, w->offsets,
                             w->places, w->constants};
  }
  w->replay[1] = LITTLE_ENDIAN_CDR;
  w->times[1] = 1e-3;
  w->motion = (motion){SECOND, 2, w->times, w->ratios, w->ratios, w->rows, 3};
  w->plan.period = 1000, w->plan.layouts = w->layouts, w->plan.layout_count = number % 4 ? 2 : 1;
  w->plan.replay = number / 2, w->plan.replay_data = w->replay;
  w->plan.replay_length = LAYOUT_A, w->plan.rest = w->row;
  w->plan.motion = number % 5 ? &w->motion : NULL;
  w->plan.next_motion = number % 7 ? NULL : &w->motion;
  return &w->plan;
}

static void read_reports(void)
{
  int64_t head = read_number(&loop.head), k = read_number(&loop.tail);
  for (; k < head; k++) {
    const slot *s = (slot *)(ring + k % SLOTS * loop.slot_size);
    const double *numbers = (const double *)(s + 1);
    const uint8_t *data = (const uint8_t *)(numbers + PATH);
    check(s->kind >= ANSWERED && s->kind <= HEARD && s->length <= LARGEST, "a report");
    check(are_equal(numbers + TAU), "torques of one plan in a report");
    long sum = 0;
    for (int64_t byte = 0; byte < s->length; byte++)
      sum += data[byte];
    check(sum >= 0 && s->end >= s->begin, "its message and its times");
    kinds[s->kind]++;
  }
  write_number(&loop.tail, head);
}

static void *thread(void *b) { return run(b); }

static bool all_kinds_are_read(void)
{
  for (int k = 0; k < 4; k++)
    if (kinds[k] < FEWEST)
      return false;
  return true;
}

/* Run the loop while plans change, until it ends or enough is read; return its code. */
static int64_t run_while_plans_change(bool ends)
{
  plan *waiting[PLANS];
  int count = 0;
  pthread_t id;
  loop.stop = loop.ended = loop.broken = loop.head = loop.tail = loop.replayed = 0;
  loop.kept_length = loop.refused = 0;
  loop.plan = waiting[count++] = new_plan(1);
  check(pthread_create(&id, NULL, thread, &loop) == 0, "a thread");
  for (int k = 2; !read_number(&loop.ended); k++) {
    if (!ends && k > PLANS && all_kinds_are_read())
      break;
    if (count < PLANS)
      write_number((_Atomic int64_t *)&loop.plan, (int64_t)(waiting[count++] = new_plan(k)));
    plan *in_use = (plan *)read_number((_Atomic int64_t *)&loop.in_use);
    for (int place = 0; place < count; place++)
      if (waiting[place] == in_use) {
        for (int old = 0; old < place; old++)
          free(waiting[old]);
        memmove(waiting, waiting + place, (size_t)(count - place) * sizeof *waiting);
        count -= place;
        break;
      }
    if (k % 5)
      read_reports();
    write_number(&loop.simulated, k / 10 % 2);
    nanosleep(&(struct timespec){0, 50000}, NULL);
  }
  write_number(&loop.stop, 1);
  pthread_join(id, NULL);
  read_reports();
  for (int k = 0; k < count; k++)
    free(waiting[k]);
  return loop.ended;
}

int main(void)
{
  static int handles[] = {0, 1, 2};
  loop = (block){
    .ring = ring, .slots = SLOTS, .slot_size = sizeof ring / SLOTS, .largest = LARGEST,
    .event = &now, .path = (path_head *)path, .result = (path_head *)result, .state = state,
    .torques = path + TAU, .path_size = PATH, .torque_count = JOINTS, .state_size = NUMBERS,
    .guard_length = GUARD_LENGTH, .guard_at = GUARD_AT, .guard_numbers = guard_numbers,
    .guard_count = 4, .kept = kept, .outputs = outputs, .output_count = 2,
    .request = {&handles[2], &taken[2], outputs_of[2], NULL}, .wait_set = handles,
    .wake = handles, .clear = nothing, .add_subscription = added,
    .add_guard_condition = added, .wait = waited, .take = take_drawn,
    .publish = publish_checked, .clock = system_clock, .steady = steady_clock,
    .rest_for = rested};
  for (int k = 0; k < 2; k++)
    outputs[k] = (output){&handles[k], &taken[k], outputs_of[k], stamps[k]};
  static message received[3];
  input *inputs[] = {&loop.states, &loop.clock_messages, &loop.guard_messages};
  for (int k = 0; k < 3; k++)
    *inputs[k] = (input){&handles[k], &received[k], information[k], 0};

  check(run_while_plans_change(false) == 0, "an end that was asked for");
  check(loop.lost > 0 && loop.not_taken > 0 && loop.refused == 0, "the counters");
  check(answered > FEWEST && published > FEWEST, "answers");

  /* A refused publication ends the thread with zeros, or silently if there is a guard. */
  for (int guarded = 0; guarded < 2; guarded++) {
    for (int k = 0; k < 3; k++)
      rule_counts[k] = guarded ? 12 : 4;
    refuses_at = published + 20;
    check(run_while_plans_change(true) == 77 && loop.refused == 77, "the end");
    check(guarded ? zeros == 0 : zeros == 2, "zeros on both outputs, or silence");
  }
  for (int k = 0; k < 3; k++)
    free(received[k].data);
  printf("answered %ld, published %ld, lost %ld\n", answered, published, (long)loop.lost);
  return 0;
}
