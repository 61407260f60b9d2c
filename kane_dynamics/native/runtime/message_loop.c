/*
 * A thread that answers serialized messages without the interpreter of Python.
 *
 * The thread waits for messages, runs a cycle of compiled rules for each of them,
 * publishes the result, and reports each cycle in a ring that Python reads when it can.
 * It never takes the interpreter's lock and allocates nothing. The addresses of the
 * functions of the middleware are passed to it, so that this file knows no middleware.
 *
 * Python reads the structures and the constants below from this text (message_loop.py).
 * The package has the LLVM text that clang makes of this file (message_loop.ll), which
 * `make llvm-texts` writes. A field has 8 bytes.
 *
 * Python writes the block before the thread starts; later it writes only `plan`, `stop`,
 * `simulated` and `tail`. Times are nanoseconds.
 */

#include <stdatomic.h>
#include <stdbool.h>
#include <stdint.h>
#include <string.h>

enum { ANSWERED, UNKNOWN, ELAPSED, HEARD };  /* kinds of reports */
enum {
  ROW_PLACE = 3,          /* of the motion's row in the tables of `answer` and `aim` */
  WAITING = 2,            /* reason of a state that is kept until torque_guard answers */
  /* Bytes of the encapsulation before a message's stamp, and of a message of /clock. */
  MESSAGE_AT = 4, CLOCK_LENGTH = 12,
  LITTLE_ENDIAN_CDR = 1,  /* in the second byte of the encapsulation */
  /* Places of the time of reception and of the publisher's number in the information on
   * a message, and a size that is larger than the information, numbers. */
  RECEIVED_AT = 1, SEQUENCE_AT = 2, INFORMATION_SIZE = 32,
  TAKE_LIMIT = 64,        /* messages in a row before the time is looked at */
  TIMED_OUT = 2, NOTHING_TAKEN = 401,  /* codes of rcl without a message: wait, take */
  PAUSE = 1000,           /* us, after a failure to take a message */
  MOST_FAILURES = 1000,   /* of an input in a row, after which the thread ends */
  SECOND = 1000000000
};

/* The functions of the middleware and of the system; rcl names the first six. */
typedef int32_t clear_function(void *wait_set);
typedef int32_t add_function(void *wait_set, void *handle, void *index);
typedef int32_t wait_function(void *wait_set, int64_t timeout);
typedef int32_t take_function(void *subscription, void *message, void *info, void *heap);
typedef int32_t publish_function(void *publisher, void *message, void *memory);
typedef int32_t clock_function(void *clock, int64_t *time);
typedef int32_t steady_function(int32_t kind, int64_t *seconds);
typedef int32_t rest_function(uint32_t microseconds);
typedef void rule_function(void **table);

/* A compiled rule, with the addresses of its arguments and of its result. */
typedef struct {
  rule_function *function;
  void **table;
} rule;

/* The times of a cycle and the place on the motion, doubles for the rules: `Event`. */
typedef struct {
  double now, stamp, moving, x, ticking, steady;
  double moment;  /* time on the motion, s; for the reports alone */
} event;

/* The numbers with which the state of the path begins: `PathState`. */
typedef struct {
  double reason, publish, sent_at, request, retries, searching, drops;
} path_head;

/* What is equal in all messages of a publisher, and where their numbers are. */
typedef struct {
  int64_t length;
  uint8_t *mask, *expected;
  int64_t count;
  int64_t *offsets, *places;  /* of each number, in the message and in the state */
  double *constants;          /* a state with what the messages lack */
} layout;

/* Polynomials of the segments of a motion, with a constant one before and one after. */
typedef struct {
  int64_t start, knots;
  double *times, *origins, *rates, *rows;
  int64_t row_size;
} motion;

/*
 * What Python may change while the thread runs. A plan does not change, except the rows
 * in its tables: Python makes a new one, and one cycle uses one plan. Rules that an arm
 * does not need have no function.
 */
typedef struct {
  int64_t period;                /* longest time between two looks at the clock */
  layout *layouts;
  int64_t layout_count;
  int64_t replay;                /* number of a message that Python passes on */
  uint8_t *replay_data;
  int64_t replay_length;
  rule judge, answer, refuse, elapse;
  rule close, closing;           /* closed loops of a state, and the search for them */
  rule aim, aiming, hold;        /* those of the desired motion, and of a stop */
  rule permit, confirm, hear;    /* torque_guard */
  int64_t longest;               /* computation, after which the guard is asked again */
  motion *motion, *next_motion;
  double *rest;                  /* the row without a motion */
} plan;

/* A serialized message: the begin of rcutils_uint8_array_t. */
typedef struct {
  uint8_t *data;
  int64_t length;
} message;

/* A subscription, or NULL where the node has none, and what receives its messages. */
typedef struct {
  void *subscription;
  message *taken;
  int64_t *information;
  int64_t failures;  /* to take a message, in a row */
} input;

/* A publisher or NULL, its message, and where the numbers and the stamp are in it. */
typedef struct {
  void *publisher;
  message *message;
  double *numbers;
  uint8_t *stamp;
} output;

/* A report in the ring; the state of the path and the message follow it. */
typedef struct {
  int64_t kind, length;       /* of the message that follows */
  int64_t lost;               /* reports so far that found the ring full */
  int64_t begin, end;         /* steady time */
  int64_t sequence;           /* the publisher's number */
  event event;
} slot;

typedef struct {
  plan *_Atomic plan;
  plan *_Atomic in_use;       /* by the cycle of now */
  _Atomic int64_t stop;
  _Atomic int64_t ended;      /* the code of rcl with which the thread ended by itself */
  _Atomic int64_t refused;    /* the code with which the middleware refused a message */
  /* Numbers of failures of the middleware to return a message, and of reports. */
  _Atomic int64_t not_taken, head, tail, lost;
  uint8_t *ring;
  int64_t slots, slot_size, largest;  /* the last: bytes of a message that fits into one */
  int64_t broken;             /* the code of rcl with which the thread is to end */
  int64_t epoch;              /* of the times of the rules */
  int64_t began, replayed;    /* steady time of the cycle; number of the last `replay` */
  /* What the rules read and write. */
  event *event;
  path_head *path, *result;
  double *torques, *state;    /* in the path; measured */
  int64_t path_size, torque_count, state_size;
  /* Inputs and outputs. */
  input states, clock_messages, guard_messages;
  _Atomic int64_t simulated;  /* whether the time is that of the messages of /clock */
  int64_t simulated_time;
  int64_t guard_length, guard_at, guard_count;  /* the guard's message; its numbers */
  double *guard_numbers;
  uint8_t *kept;              /* the message of a state that waits for torque_guard */
  int64_t kept_length;
  output *outputs;
  int64_t output_count;
  output request;             /* to torque_guard */
  /* The middleware and the system. */
  void *wait_set, *wake, *clock_handle;
  clear_function *clear;
  add_function *add_subscription, *add_guard_condition;
  wait_function *wait;
  take_function *take;
  publish_function *publish;
  clock_function *clock;
  steady_function *steady;
  rest_function *rest_for;
} block;

/* ------------------------------------------------------------------- times and rules */

/* Return the steady time. */
static int64_t steady_time(block *b)
{
  int64_t time[2];  /* s, ns */
  b->steady(1, time);  /* CLOCK_MONOTONIC */
  return time[0] * SECOND + time[1];
}

/* Read the steady clock for the rules. */
static int64_t read_steady(block *b)
{
  int64_t steady = steady_time(b);
  b->event->steady = (double)steady;
  return steady;
}

/* Read the clock for the rules. Return the time since the epoch. */
static int64_t read_clock(block *b)
{
  int64_t time = 0;
  if (atomic_load_explicit(&b->simulated, memory_order_acquire))
    time = b->simulated_time;
  else
    b->clock(b->clock_handle, &time);
  b->event->ticking = time != 0;
  b->event->now = (double)(time - b->epoch);
  return time - b->epoch;
}

static bool exists(const rule *r) { return r->function != NULL; }

/* Make the result of a rule the state of the path. */
static void keep_result(block *b)
{
  memcpy(b->path, b->result, (size_t)b->path_size * sizeof(double));
}

/* Let a rule, if the plan has it, compute the next state of the path. */
static void step(block *b, const rule *r)
{
  if (!exists(r))
    return;
  r->function(r->table);
  keep_result(b);
}

/* Search a configuration of closed loops, call by call. */
static void search(block *b, const rule *r)
{
  while (exists(r) && b->path->searching > 0.5)
    step(b, r);
}

static bool accepted(const block *b) { return b->path->reason < 0.5; }

/* ---------------------------------------------------------------------- publications */

/* Publish a message. If the middleware refuses it, the thread ends after this turn. */
static void publish(block *b, const output *to)
{
  int32_t code = to->publisher ? b->publish(to->publisher, to->message, NULL) : 0;
  if (code)
    b->refused = code;
}

static void write_stamp(uint8_t *to, int64_t time)
{
  int32_t stamp[] = {(int32_t)(time / SECOND), (int32_t)(time % SECOND)};
  memcpy(to, stamp, sizeof stamp);
}

/* Publish the torques, and a request to torque_guard, if the rules say so. */
static void publish_result(block *b)
{
  for (int64_t k = 0; b->path->publish > 0.5 && k < b->output_count; k++) {
    const output *to = &b->outputs[k];
    memcpy(to->numbers, b->torques, (size_t)b->torque_count * sizeof(double));
    if (to->stamp)
      write_stamp(to->stamp, (int64_t)b->path->sent_at + b->epoch);
    publish(b, to);
  }
  if (b->path->request > -0.5) {
    *b->request.numbers = b->path->request;
    publish(b, &b->request);
  }
}

/* Report a cycle in the ring, without a message that a slot cannot hold. */
static void report(block *b, int64_t kind, const uint8_t *data, int64_t length)
{
  int64_t head = atomic_load_explicit(&b->head, memory_order_relaxed);
  int64_t tail = atomic_load_explicit(&b->tail, memory_order_acquire);
  if (head - tail >= b->slots) {
    b->lost++;
    return;
  }
  slot *to = (slot *)(b->ring + head % b->slots * b->slot_size);
  to->kind = kind;
  to->length = length <= b->largest ? length : 0;
  to->lost = b->lost;
  to->begin = b->began;
  to->end = steady_time(b);
  to->sequence = b->states.information[SEQUENCE_AT];
  to->event = *b->event;
  size_t size = (size_t)b->path_size * sizeof(double);
  uint8_t *after = (uint8_t *)(to + 1);
  memcpy(after, b->path, size);
  memcpy(after + size, data, (size_t)to->length);
  atomic_store_explicit(&b->head, head + 1, memory_order_release);
}

/* --------------------------------------------------------------------------- a state */

/* Return whether the bytes of a message are those of a layout where its mask is 1. */
static bool matches(const layout *l, const uint8_t *data, int64_t length)
{
  uint8_t difference = 0;
  if (length != l->length)
    return false;
  for (int64_t k = 0; k < length; k++)
    difference |= (data[k] & l->mask[k]) ^ l->expected[k];
  return difference == 0;
}

/* Return the layout of a message, or NULL if Python has yet to learn it. */
static const layout *layout_of(const plan *p, const uint8_t *data, int64_t length)
{
  for (int64_t k = 0; k < p->layout_count; k++)
    if (matches(&p->layouts[k], data, length))
      return &p->layouts[k];
  return NULL;
}

/* Copy the numbers of a message into the state. */
static void gather(block *b, const layout *l, const uint8_t *data)
{
  memcpy(b->state, l->constants, (size_t)b->state_size * sizeof(double));
  for (int64_t k = 0; k < l->count; k++)
    memcpy(&b->state[l->places[k]], data + l->offsets[k], sizeof(double));
}

/* Return the time with which a message begins: that of its header, or of /clock. */
static int64_t first_time(const uint8_t *data)
{
  uint32_t time[2];  /* s, which may be negative, and ns */
  memcpy(time, data + MESSAGE_AT, sizeof time);
  return (int32_t)time[0] * (int64_t)SECOND + time[1];
}

/* Return the row of the motion's segment at a time; the event says where it is there. */
static double *segment_row(block *b, const plan *p, int64_t time)
{
  const motion *m = p->motion;
  if (p->next_motion && time >= p->next_motion->start)
    m = p->next_motion;
  b->event->moving = m != NULL;
  if (!m)
    return p->rest;
  double t = (double)(time - m->start) / 1e9;
  int64_t low = 0, high = m->knots;  /* the number of knots up to t is between them */
  while (low < high) {
    int64_t middle = (low + high) / 2;
    if (t < m->times[middle])
      high = middle;
    else
      low = middle + 1;
  }
  b->event->moment = t;
  b->event->x = (t - m->origins[low]) * m->rates[low];
  return m->rows + low * m->row_size;
}

/* Judge the state of a time and compute its torque; return whether it is answered. */
static bool compute(block *b, const plan *p, int64_t moment)
{
  /* Compare the state with the limits and close the loops. */
  step(b, &p->judge);
  if (accepted(b)) {
    step(b, &p->close);
    search(b, &p->closing);
  }
  step(b, &p->permit);
  if (!accepted(b))
    return false;

  /* Find the desired motion. */
  double *row = segment_row(b, p, moment);
  p->answer.table[ROW_PLACE] = row;
  if (exists(&p->aim))
    p->aim.table[ROW_PLACE] = row;
  step(b, &p->aim);
  search(b, &p->aiming);
  if (!accepted(b))
    return false;

  /* Compute the torque. A thread that was interrupted meanwhile asks the guard again. */
  p->answer.function(p->answer.table);
  if (exists(&p->confirm) && read_steady(b) - b->began > p->longest) {
    step(b, &p->confirm);
    if (!accepted(b))
      return false;
    p->answer.function(p->answer.table);  /* `confirm` has overwritten the result */
  }
  keep_result(b);
  return accepted(b);
}

/* Command what follows a state that is not answered; keep its message if it waits. */
static void refuse(block *b, const plan *p, const uint8_t *data, int64_t length)
{
  if (b->path->reason == WAITING && length <= b->largest) {
    memmove(b->kept, data, (size_t)length);
    b->kept_length = length;
  }
  step(b, &p->refuse);
  search(b, &p->aiming);
  step(b, &p->hold);
}

/* Answer one message: read and judge it, compute the command, publish it, report. */
void cycle(block *b, const plan *p, const uint8_t *data, int64_t length)
{
  b->began = read_steady(b);
  int64_t now = read_clock(b);
  const layout *l = layout_of(p, data, length);
  if (!l) {  /* Python learns the layout and passes the message again */
    report(b, UNKNOWN, data, length);
    return;
  }
  gather(b, l, data);
  int64_t time = first_time(data);
  int64_t stamp = time ? time - b->epoch : now;
  b->event->stamp = (double)stamp;
  if (compute(b, p, now < stamp ? now : stamp))
    b->kept_length = 0;
  else
    refuse(b, p, data, length);
  publish_result(b);
  report(b, ANSWERED, data, length);
}

/* -------------------------------------------------------------------- between states */

/* Look at the time: zeros, if states stay away. */
void look_at_time(block *b, const plan *p)
{
  read_steady(b);
  read_clock(b);
  double drops = b->path->drops;
  step(b, &p->elapse);
  publish_result(b);
  if (b->path->drops != drops)
    report(b, ELAPSED, b->kept, 0);  /* without a message */
}

/* Note a message of torque_guard, and answer the state that waited for it. */
void hear(block *b, const plan *p, const uint8_t *data, int64_t length)
{
  if (length != b->guard_length)
    return;
  b->began = read_steady(b);
  read_clock(b);
  memcpy(b->guard_numbers, data + b->guard_at, (size_t)b->guard_count * sizeof(double));
  step(b, &p->hear);
  publish_result(b);
  report(b, HEARD, b->kept, 0);
  if (b->path->retries > 0.5 && b->kept_length) {
    length = b->kept_length;
    b->kept_length = 0;
    cycle(b, p, b->kept, length);
  }
}

/* Note the simulated time of a message of /clock. */
static void hear_clock(block *b, const plan *p, const uint8_t *data, int64_t length)
{
  (void)p;
  if (length >= CLOCK_LENGTH)
    b->simulated_time = first_time(data);
}

/* ------------------------------------------------------------------------ the thread */

/* Take a message; return whether there was one. After a failure the thread rests. */
static bool take(block *b, input *from)
{
  int32_t code = b->take(from->subscription, from->taken, from->information, NULL);
  if (code == NOTHING_TAKEN)
    return false;
  if (code == 0) {
    from->failures = 0;
    return true;
  }
  b->not_taken++;
  from->failures++;
  b->rest_for(PAUSE);
  if (from->failures >= MOST_FAILURES)
    b->broken = code;
  return false;
}

/* Take all messages of an input, if there is one, and pass each to a function. */
static void take_all(block *b, const plan *p, input *from,
                     void use(block *, const plan *, const uint8_t *, int64_t))
{
  for (int k = 0; from->subscription && k < TAKE_LIMIT && take(b, from); k++)
    use(b, p, from->taken->data, from->taken->length);
}

/* Answer a taken state. One without a stamp is of its reception, however long it waits. */
static void answer_taken(block *b, const plan *p, const uint8_t *data, int64_t length)
{
  int64_t received = b->states.information[RECEIVED_AT];
  if (atomic_load_explicit(&b->simulated, memory_order_acquire))
    received = b->simulated_time;
  if (length >= CLOCK_LENGTH && data[1] == LITTLE_ENDIAN_CDR && received > 0
      && !first_time(data))
    write_stamp(b->states.taken->data + MESSAGE_AT, received);
  cycle(b, p, data, length);
}

/* Wait for a message, for the end of a period or for Python; return a code of rcl. */
static int32_t wait_for_message(block *b, int64_t period)
{
  const input *inputs[] = {&b->states, &b->clock_messages, &b->guard_messages};
  int32_t code = b->clear(b->wait_set);
  for (int k = 0; k < 3; k++)
    if (inputs[k]->subscription)
      code |= b->add_subscription(b->wait_set, inputs[k]->subscription, NULL);
  code |= b->add_guard_condition(b->wait_set, b->wake, NULL);
  int32_t waited = b->wait(b->wait_set, period);
  return code | (waited == TIMED_OUT ? 0 : waited);
}

/* Return the latest plan, and state its use: Python may free the one before. */
static plan *plan_of_now(block *b)
{
  plan *p = atomic_load_explicit(&b->plan, memory_order_acquire);
  atomic_store_explicit(&b->in_use, p, memory_order_release);
  return p;
}

/* The thread: wait, answer the messages that are there, look at the time. */
void *run(block *b)
{
  int64_t code = 0;
  bool silent = false;
  while (!code) {
    const plan *p = plan_of_now(b);
    if (atomic_load_explicit(&b->stop, memory_order_acquire))
      return NULL;
    if (p->replay != b->replayed) {
      b->replayed = p->replay;
      cycle(b, p, p->replay_data, p->replay_length);
    }
    code = wait_for_message(b, p->period);
    if (code)
      break;
    p = plan_of_now(b);  /* it may have changed while the thread waited */
    take_all(b, p, &b->clock_messages, hear_clock);  /* states are not ahead of it then */
    take_all(b, p, &b->states, answer_taken);
    take_all(b, p, &b->guard_messages, hear);
    look_at_time(b, p);
    code = b->refused ? b->refused : b->broken;
    silent = b->refused && exists(&p->permit);
  }
  /* Zeros, because no state comes any more; but torque_guard takes over from silence. */
  if (!silent) {
    memset(b->torques, 0, (size_t)b->torque_count * sizeof(double));
    b->path->publish = 1.0;
    b->path->request = 0.0;
    publish_result(b);
  }
  atomic_store_explicit(&b->ended, code, memory_order_release);
  return NULL;
}

/* ------------------------------------------------------------------------ for Python */

/* Write a number after everything before it. */
void write_number(_Atomic int64_t *to, int64_t value)
{
  atomic_store_explicit(to, value, memory_order_release);
}

/* Read a number before everything after it. */
int64_t read_number(_Atomic int64_t *from)
{
  return atomic_load_explicit(from, memory_order_acquire);
}

/*
 * Answer a message again and again, with the present time as its stamp, for measurements.
 * Without `works` only the clocks are read.
 */
void repeat_cycles(block *b, uint8_t *data, int64_t length, int64_t times,
                   int64_t *durations, bool works)
{
  const plan *p = atomic_load_explicit(&b->plan, memory_order_relaxed);
  for (int64_t k = 0; k < times; k++) {
    int64_t before = read_steady(b);
    write_stamp(data + MESSAGE_AT, read_clock(b) + b->epoch);
    if (works)
      cycle(b, p, data, length);
    durations[k] = steady_time(b) - before;
  }
}
