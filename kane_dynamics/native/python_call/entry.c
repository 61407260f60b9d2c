/*
 * Built-in functions of CPython that call compiled kernels without running Python.
 *
 * Every function has a table, its `self`, which says what the kernel takes and returns.
 * A call that is not exactly what the table says goes to `otherwise`: lists of numbers
 * become arrays, small batches run in SIMD lanes, and the Python function of the table
 * does the rest, which converts arguments and raises errors. This code raises nothing
 * itself.
 *
 * Python reads the structures and the constants below from this text (entry.py). The
 * package has the LLVM text that clang makes of this file (entry.ll), which
 * `make llvm-texts` writes. A field has 8 bytes, except in the objects of CPython and
 * numpy, whose layouts `entry.supported` verifies on the running interpreter.
 */

#include <stdbool.h>
#include <stdint.h>
#include <string.h>

enum {
  REQUIRED,           /* by position */
  OPTIONAL,           /* by position or keyword */
  KEYWORD,            /* by keyword */
  NUMBER,             /* by keyword, a float of at least 0 */
  FIXED,              /* no part of a call */
  METHODS = 64,       /* most methods of a class */
  POINTERS = 32,      /* most arguments, defaults and results of a kernel together */
  MOST_PARTS = 4,     /* most arrays of a result */
  MOST_AXES = 8,
  READABLE = 0x101,   /* numpy's flags C_CONTIGUOUS, ALIGNED */
  WRITEABLE = 0x400,
  FRESH = 0x505,      /* READABLE, WRITEABLE, OWNDATA */
  FLOAT64 = 12,       /* numpy's number of the type */
  ROW = 4             /* words of an argument in the table of a batch */
};
#define LARGEST 0x1.fffffffffffffp+1023

/* The objects of CPython and numpy. Only arrays and tuples that are no constants are counted. */
typedef struct {
  int32_t count, flags;
  void *type;
} object;
typedef struct { object head; double value; } real;
typedef struct { object head; int64_t length; object *items[]; } tuple;
typedef struct { object head; int64_t length; object **items; } list;
typedef struct {
  object head;
  double *data;
  int32_t axes, unused;
  int64_t *lengths, *strides;
  object *base, *kind;
  int32_t bits, unused_bits;
  object *weak;
} array;

typedef object *call_function(object *self, object **given, int64_t count, object *names);
typedef void kernel_function(double **pointers);
typedef array *array_function(void *type, int32_t axes, int64_t *lengths, int32_t number,
                              void *strides, void *data, int32_t size, int32_t flags,
                              void *owner);
typedef object *tuple_function(int64_t length);
typedef object *number_function(double number);
typedef double value_function(object *number);
typedef object *error_function(void);
typedef void clear_function(void);
typedef void release_function(object *thing);
typedef object *item_function(object *dictionary, object *key);

/* Types and functions of CPython and numpy, equal for all tables. */
typedef struct {
  void *ndarray, *float64, *real_type, *whole_type, *number_type, *list_type, *tuple_type;
  void *text_type, *none;
  array_function *new_array;
  tuple_function *new_tuple;
  number_function *new_number;
  value_function *number_of;
  error_function *error;
  clear_function *clear_error;
  release_function *release;
  item_function *item;
  call_function *call;
} interpreter;

/* An argument of a kernel for one state. */
typedef struct {
  int64_t kind, axes, size;
  int64_t *lengths;
  double limit;       /* largest absolute value */
  int64_t flags;      /* that its array must have */
  void *name;         /* interned, for calls with keywords */
  void *stand_in;     /* for an argument that is left out; null: the fallback serves the call */
} argument;

/* An array of the result: `rows` runs of `width` numbers, `stride` numbers apart. */
typedef struct {
  int64_t axes;
  int64_t *lengths;
  int64_t start, rows, width, stride;
} part;

/* `run_batch` of loops.c: of the words of a job, from a state to another. */
typedef int64_t batch_function(const int64_t *job, int64_t begin, int64_t end);
/* Batches: the kernel in SIMD lanes, null until it is compiled, and the most states. */
typedef struct {
  void *kernel;
  batch_function *run;
  int64_t width, most;
} lanes;

typedef struct {
  call_function *code;        /* what serves a call of a method */
  interpreter *python;
  object *fallback;
  object *choices;            /* of `choose`: functions by their first argument */
  kernel_function *kernel;
  int64_t count;              /* of the arguments */
  argument *arguments;
  int64_t by_name;            /* calls may have keywords and lack arguments */
  int64_t unread;             /* of further arguments with which a call may end */
  int64_t slots;              /* pointers of the kernel */
  double **pointers;          /* of `entry` the defaults alone, after null for arguments */
  int64_t memory;             /* argument that the rest of the result overwrites, or -1 */
  int64_t parts;              /* 0: the result is a number */
  part *part;
  int64_t size;               /* of the kernel's result */
  double *scratch;            /* for a result that is not one array */
  array **ring;               /* the last two arrays of each part */
  object *result;             /* of `bound` */
  lanes *batches;             /* null: none */
} table;

static table *table_of(object *self) { return (table *)((array *)self)->data; }

static object *fall_back(table *t, object **given, int64_t count, object *names)
{
  return t->python->call(t->fallback, given, count, names);
}

typedef double four __attribute__((vector_size(32), aligned(8)));
typedef int64_t four_words __attribute__((vector_size(32), aligned(8)));

/* Whether all numbers are finite and at most `limit` in absolute value. */
static inline bool within(const double *x, int64_t size, double limit)
{
  if (size < 4) {
    bool good = true;
    for (int64_t i = 0; i < size; ++i) good &= __builtin_fabs(x[i]) <= limit;
    return good;
  }
  const int64_t sign = INT64_MAX;
  const four_words magnitude = {sign, sign, sign, sign};
  const four limits = {limit, limit, limit, limit};
  four_words good = {-1, -1, -1, -1};
  /* The last four may overlap those before. */
  for (int64_t i = 0; i < size; i += 4) {
    const int64_t at = i + 4 <= size ? i : size - 4;
    good &= (four)(*(const four_words *)(x + at) & magnitude) <= limits;
  }
  return (good[0] & good[1] & good[2] & good[3]) != 0;
}

/* Whether an object is an array of float64 with these flags and as many axes. */
static inline bool is_array(const interpreter *python, const object *thing, int64_t axes,
                            int64_t flags)
{
  const array *x = (const array *)thing;
  return thing->type == python->ndarray && x->axes == axes && x->kind == python->float64
         && (x->bits & flags) == flags;
}

static inline bool has_lengths(const array *x, const int64_t *lengths, int64_t first,
                               int64_t axes)
{
  for (int64_t k = 0; k < axes; ++k)
    if (x->lengths[first + k] != lengths[k]) return false;
  return true;
}

/*
 * Return a part's array, with a reference for the caller; null after an error of Python.
 *
 * One of the last two, if nobody else refers to it and it still is what it was. Two are
 * needed because in `tau = f(...)` the old result exists until the new one is assigned.
 */
static inline array *result_array(table *t, const part *p, array **ring)
{
  const interpreter *python = t->python;
  for (int k = 0; k < 2; ++k) {
    array *x = ring[k];
    if (x->head.count == 1 && !x->weak && is_array(python, (object *)x, p->axes, FRESH)
        && has_lengths(x, p->lengths, 0, p->axes)) {
      ++x->head.count;
      return x;
    }
  }
  array *made = python->new_array(python->ndarray, (int32_t)p->axes, p->lengths, FLOAT64, 0,
                                  0, 0, 0, 0);
  if (!made) return 0;
  /* The ring moves on before the oldest array is released, which may run any code. */
  ++made->head.count;
  object *oldest = (object *)ring[0];
  ring[0] = ring[1];
  ring[1] = made;
  python->release(oldest);
  return made;
}

static void release_all(const interpreter *python, array **arrays, int64_t count)
{
  for (int64_t k = 0; k < count; ++k) python->release((object *)arrays[k]);
}

static object *otherwise(object *self, object **given, int64_t count, object *names);

/*
 * Write the arguments of a call with keywords in the order of the kernel; whether it has
 * all that it needs. Names are interned, so that their addresses tell them apart.
 */
static bool sorted(table *t, object **given, int64_t count, object *names, object **things)
{
  const void *none = t->python->none;
  for (int64_t k = 0; k < t->count; ++k) {
    const argument *a = t->arguments + k;
    things[k] = a->stand_in;
    if (k < count) {
      if (a->kind > OPTIONAL) return false;
      if (a->kind == REQUIRED || given[k] != none) things[k] = given[k];
    } else if (a->kind == REQUIRED) {
      return false;
    }
  }
  if (count > t->count) return false;
  const int64_t named = names ? ((tuple *)names)->length : 0;
  for (int64_t i = 0; i < named; ++i) {
    const void *name = ((tuple *)names)->items[i];
    int64_t k = count;  /* an argument without this name, or one that has a position */
    while (k < t->count && (t->arguments[k].name != name || t->arguments[k].kind == FIXED))
      ++k;
    if (k == t->count) return false;
    if (given[count + i] != none) things[k] = given[count + i];
  }
  for (int64_t k = 0; k < t->count; ++k)
    if (!things[k]) return false;
  return true;
}

/* Compute a kernel for arrays of one state. */
object *entry(object *self, object **given, int64_t count, object *names)
{
  table *t = table_of(self);
  const interpreter *python = t->python;
  object *things[POINTERS];
  object **used = given;
  if (t->by_name) {
    if (!sorted(t, given, count, names, things)) return otherwise(self, given, count, names);
    used = things;
  } else if (names || (uint64_t)(count - t->count) > (uint64_t)t->unread) {
    return otherwise(self, given, count, names);
  }
  double *pointers[POINTERS];
  for (int64_t k = 0; k < t->count; ++k) {
    const argument *a = t->arguments + k;
    array *x = (array *)used[k];
    if (a->kind == NUMBER) {
      real *number = (real *)x;
      if (number->head.type != python->real_type || !(number->value >= 0.0)
          || number->value > LARGEST)
        return otherwise(self, given, count, names);
      pointers[k] = &number->value;
      continue;
    }
    if (a->kind != FIXED
        && !(is_array(python, (object *)x, a->axes, a->flags)
             && has_lengths(x, a->lengths, 0, a->axes)
             && within(x->data, a->size, a->limit)))
      return otherwise(self, given, count, names);
    pointers[k] = x->data;
  }
  for (int64_t k = t->count; k < t->slots - 1; ++k) pointers[k] = t->pointers[k];

  if (t->parts == 0) {
    double number;
    pointers[t->slots - 1] = &number;
    t->kernel(pointers);
    if (!within(&number, 1, LARGEST)) return otherwise(self, given, count, names);
    return python->new_number(number);
  }
  /* All arrays before the kernel runs: to make one may run any code, even this function. */
  array *results[MOST_PARTS] = {0};
  for (int64_t k = 0; k < t->parts; ++k) {
    results[k] = result_array(t, t->part + k, t->ring + 2 * k);
    if (!results[k]) {
      release_all(python, results, k);
      return 0;
    }
  }
  object *returned = (object *)results[0];
  if (t->parts > 1) {
    returned = python->new_tuple(t->parts);
    if (!returned) {
      release_all(python, results, t->parts);
      return 0;
    }
    for (int64_t k = 0; k < t->parts; ++k) ((tuple *)returned)->items[k] = (object *)results[k];
  }
  double *numbers = t->scratch ? t->scratch : results[0]->data;
  pointers[t->slots - 1] = numbers;
  t->kernel(pointers);
  if (!within(numbers, t->size, LARGEST)) {  /* the fallback explains the error */
    python->release(returned);
    return otherwise(self, given, count, names);
  }
  if (t->scratch) {
    for (int64_t k = 0; k < t->parts; ++k) {
      const part *p = t->part + k;
      for (int64_t r = 0; r < p->rows; ++r)
        memcpy(results[k]->data + r * p->width, numbers + p->start + r * p->stride,
               8 * p->width);
    }
    if (t->memory >= 0) {
      const int64_t size = t->arguments[t->memory].size;
      memcpy(pointers[t->memory], numbers + t->size - size, 8 * size);
    }
  }
  return returned;
}

/*
 * Return the results of a batch in SIMD lanes, in this thread and with the GIL; null if the
 * arguments are no batch or numbers are not finite. `failed` after an error of Python.
 */
static object *small_batch(table *t, object **given, int64_t count, bool *failed)
{
  const interpreter *python = t->python;
  if (!t->batches || !t->batches->kernel || t->by_name || count != t->count || t->memory >= 0
      || t->parts > 1)
    return 0;
  int64_t states = 0;
  int64_t rows[POINTERS * ROW];
  memset(rows, 0, 8 * ROW * t->slots);
  for (int64_t k = 0; k < count; ++k) {
    const argument *a = t->arguments + k;
    const array *x = (array *)given[k];
    if (!is_array(python, given[k], a->axes + 1, a->flags)
        || !has_lengths(x, a->lengths, 1, a->axes) || (k && x->lengths[0] != states))
      return 0;
    states = x->lengths[0];
    rows[ROW * k] = (int64_t)x->data;
    rows[ROW * k + 1] = 8 * a->size;
  }
  if (states < 1 || states > t->batches->most) return 0;
  /* All states share the defaults and the parameters. */
  for (int64_t k = count; k < t->slots - 1; ++k) rows[ROW * k] = (int64_t)t->pointers[k];
  int64_t lengths[MOST_AXES] = {states};
  const int64_t axes = t->parts ? t->part->axes : 0;
  for (int64_t k = 0; k < axes; ++k) lengths[k + 1] = t->part->lengths[k];
  array *made = python->new_array(python->ndarray, (int32_t)axes + 1, lengths, FLOAT64, 0, 0,
                                  0, 0, 0);
  *failed = !made;
  if (!made) return 0;
  rows[ROW * (t->slots - 1)] = (int64_t)made->data;
  rows[ROW * (t->slots - 1) + 1] = 8 * t->size;
  const int64_t job[] = {(int64_t)t->batches->kernel, (int64_t)rows, t->slots, 0, 0, 0,
                         0, states, 1, t->batches->width, 0};
  if (t->batches->run(job, 0, states)) {
    python->release((object *)made);
    return 0;
  }
  return (object *)made;
}

/*
 * Return a list or tuple of floats and integers as an array, with a reference for the
 * caller; null if it is something else. `failed` after an error of Python.
 */
static array *array_of(const interpreter *python, object *thing, bool *failed)
{
  const bool is_list = thing->type == python->list_type;
  if (!is_list && thing->type != python->tuple_type) return 0;
  int64_t length = ((list *)thing)->length;
  array *made = python->new_array(python->ndarray, 1, &length, FLOAT64, 0, 0, 0, 0, 0);
  *failed = !made;
  if (!made) return 0;
  /* Only now the items: to make the array may have run code that changed the list. */
  object **items = is_list ? ((list *)thing)->items : ((tuple *)thing)->items;
  bool good = ((list *)thing)->length == length;
  for (int64_t i = 0; good && i < length; ++i) {
    double *number = made->data + i;
    const void *type = items[i]->type;
    if (type == python->real_type || type == python->number_type) {
      *number = ((real *)items[i])->value;
    } else if (type == python->whole_type) {
      *number = python->number_of(items[i]);
      if (*number == -1.0 && python->error()) {
        python->clear_error();
        good = false;
      }
    } else {
      good = false;
    }
  }
  if (good) return made;
  python->release((object *)made);
  return 0;
}

/* Serve a call that is not one of arrays of one state. */
static object *otherwise(object *self, object **given, int64_t count, object *names)
{
  table *t = table_of(self);
  const interpreter *python = t->python;
  const int64_t total = count + (names ? ((tuple *)names)->length : 0);
  if (total > POINTERS) return fall_back(t, given, count, names);
  bool failed = false;
  if (!names) {
    object *results = small_batch(t, given, count, &failed);
    if (results || failed) return results;
  }
  /* The same call with arrays in place of lists, but for keywords: `out` has to be an array. */
  object *converted[POINTERS];
  array *made[POINTERS];
  int64_t lists = 0;
  for (int64_t k = 0; k < total && !failed; ++k) {
    converted[k] = given[k];
    array *x = k < count ? array_of(python, given[k], &failed) : 0;
    if (x) converted[k] = (object *)(made[lists++] = x);
  }
  object *answer = 0;
  if (!failed && lists)
    answer = entry(self, converted, count, names);
  else if (!failed)
    answer = fall_back(t, given, count, names);
  release_all(python, made, lists);
  return answer;
}

/* Compute a kernel on fixed memory: a method without arguments. */
object *bound(object *self, object **given, int64_t count)
{
  table *t = table_of(self);
  bool good = count == 0;
  for (int64_t k = 0; good && k < t->count; ++k)
    good = within(t->pointers[k], t->arguments[k].size, t->arguments[k].limit);
  if (!good) return fall_back(t, given, count, 0);
  t->kernel(t->pointers);
  const double *numbers = t->pointers[t->slots - 1];
  if (!within(numbers, t->size, LARGEST)) return fall_back(t, given, count, 0);
  if (t->parts == 0) return t->python->new_number(*numbers);
  ++t->result->count;
  return t->result;
}

/* Call the function that belongs to the first argument, a name or a tuple of names. */
object *choose(object *self, object **given, int64_t count, object *names)
{
  table *t = table_of(self);
  const interpreter *python = t->python;
  if (count > 0
      && (given[0]->type == python->text_type || given[0]->type == python->tuple_type)) {
    object *chosen = python->item(t->choices, given[0]);
    if (chosen) return python->call(chosen, given + 1, count - 1, names);
    python->clear_error();  /* such as of a tuple that has no hash */
  }
  return fall_back(t, given, count, names);
}

/* In place of `bound`, of kernels that compute nothing. */
object *refer(object *self, object **given, int64_t count, object *owner)
{
  (void)owner;
  return fall_back(table_of(self), given, count, 0);
}

/* The first call of a method: the fallback returns the table of the object. */
object *unmade(object *self, object **given, int64_t count, object *owner)
{
  table *t = table_of(self);
  object *made = fall_back(t, &owner, 1, 0);
  if (!made) return 0;
  object *answer = table_of(made)->code(made, given, count, owner);
  t->python->release(made);
  return answer;
}

static object *refusal;  /* table of the methods of objects that were not initialized */
void refuse_by(object *refusing) { refusal = refusing; }

/*
 * Methods: the first slot of their object holds an array of the addresses of its tables.
 * CPython calls a method faster than a function that is an attribute.
 */
static __attribute__((noinline)) object *method(int64_t place, object *owner, object **given, int64_t count)
{
  array *tables = ((array **)(owner + 1))[0];
  object *own = tables ? ((object **)(void *)tables->data)[place] : refusal;
  return table_of(own)->code(own, given, count, owner);
}
#define METHOD(place) \
  object *method_##place(object *owner, object **given, int64_t count) \
  { \
    return method(0##place, owner, given, count); \
  }
#define EIGHT(tens) METHOD(tens##0) METHOD(tens##1) METHOD(tens##2) METHOD(tens##3) \
  METHOD(tens##4) METHOD(tens##5) METHOD(tens##6) METHOD(tens##7)
/* The number of a method is octal. */
EIGHT(0) EIGHT(1) EIGHT(2) EIGHT(3) EIGHT(4) EIGHT(5) EIGHT(6) EIGHT(7)
