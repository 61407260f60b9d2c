/*
 * Loops over kernels: one state after the other, or a batch in lanes and threads; and the
 * function by which XLA calls a batch.
 *
 * A kernel has its arguments first and its result last. A lane kernel computes as many
 * states at a time as a register has lanes.
 */

#define _GNU_SOURCE
#include <alloca.h>
#include <math.h>
#include <pthread.h>
#include <stdatomic.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>

enum {
    POINTER_SLOTS = 32, /* arguments, defaults and result of one kernel together */
    MOST_LANES = 8,
    PIECES = 64, /* of each share of a batch */
    /* Of the calling thread to join another before it sleeps: some 50 us, in which most
       end. A processor that has slept takes longer than that to wake up. */
    TRIES = 20000,
    STACK = 8388608, /* bytes of a thread's stack */
    /* Flags of `run_batch` for non-finite numbers. That of inputs is also set where several
       positions come near their limit: callers look at the numbers then. */
    BAD_INPUT = 1,
    BAD_RESULT = 2
};

typedef void state_kernel(char **pointers);
/* With the rows of each pointer's states, and two words for each lane that tell of bad numbers. */
typedef void lane_kernel(char **rows, int64_t *bad);

/* Call a kernel `count` times; advance each pointer by its stride (bytes) after each call. If the
   result of one call is the argument of the next, this integrates over time. The words of the
   table are the kernel, the count, the number of pointers, the pointers and the strides. */
void repeat(const int64_t *table)
{
    state_kernel *kernel = (state_kernel *)table[0];
    int64_t slots = table[2];
    const int64_t *strides = table + 3 + slots;
    char *pointers[POINTER_SLOTS];
    memcpy(pointers, table + 3, (size_t)slots * sizeof(char *));
    for (int64_t i = 0; i < table[1]; i++) {
        kernel(pointers);
        for (int64_t k = 0; k < slots; k++)
            pointers[k] += strides[k];
    }
}

/* Where the rows of an argument or of the result are. */
typedef struct {
    char *address;
    int64_t lane, step; /* bytes between states and between steps; 0 where they share a row */
    int64_t *numbers; /* of the row of each state; null where it is that of the state */
} row;

/* States begin <= i < end, and `steps` calls of the kernel for each. If `low` is not null, each
   state's row of `low` and `high`, of `size` entries, is updated with the minimum and maximum of
   its results. */
typedef struct {
    int64_t *kernel;
    row *rows;
    int64_t slots, size;
    double *low, *high;
    int64_t begin, end, steps, width;
    _Atomic int64_t flags; /* the result: BAD_INPUT, BAD_RESULT */
} job;

/* Widen the extremes of a state by a result. */
static void widen(const job *work, int64_t state, const double *result)
{
    double *low = work->low + state * work->size;
    double *high = work->high + state * work->size;
    for (int64_t j = 0; j < work->size; j++) {
        low[j] = result[j] < low[j] ? result[j] : low[j];
        high[j] = result[j] > high[j] ? result[j] : high[j];
    }
}

/* Run a job's states from `begin` to `end` by blocks of lanes; return the flags. The last block is
   filled by repeating its last state, so that a result depends on its own state only. */
static inline __attribute__((always_inline)) int64_t
run_lanes(const job *work, int64_t begin, int64_t end, const int width)
{
    _Alignas(64) char *rows[POINTER_SLOTS * MOST_LANES];
    _Alignas(64) char *firsts[POINTER_SLOTS * MOST_LANES]; /* rows of the first step */
    _Alignas(64) int64_t bad[2 * MOST_LANES] = {0};
    int64_t states[MOST_LANES];
    int64_t distances[POINTER_SLOTS]; /* bytes between the rows of full blocks */
    lane_kernel *kernel = (lane_kernel *)work->kernel;
    int plain = work->steps == 1;
    for (int64_t k = 0; k < work->slots; k++) {
        distances[k] = work->rows[k].lane * width;
        plain = plain && !work->rows[k].numbers;
    }
    for (int64_t block = begin; block < end; block += width) {
        for (int lane = 0; lane < width; lane++)
            states[lane] = block + lane < end ? block + lane : end - 1;
        /* The rows of a full block are as far from those of the block before in every lane. */
        int follows = block > begin && block + width <= end;
        for (int64_t k = 0; k < work->slots; k++) {
            const row *slot = work->rows + k;
            char **own = rows + k * width, **first = firsts + k * width;
            if (follows && plain) { /* most batches: every block but the first and the last */
                for (int lane = 0; lane < width; lane++)
                    own[lane] += distances[k];
                continue;
            }
            for (int lane = 0; lane < width; lane++) {
                int64_t number = slot->numbers ? slot->numbers[states[lane]] : states[lane];
                first[lane] = slot->address + number * slot->lane;
                own[lane] = first[lane];
            }
        }
        for (int64_t step = 0;; ) {
            kernel(rows, bad);
            if (work->low)
                for (int lane = 0; lane < width; lane++)
                    widen(work, states[lane],
                          (const double *)rows[(work->slots - 1) * width + lane]);
            if (++step >= work->steps)
                break;
            for (int64_t k = 0; k < work->slots; k++)
                for (int lane = 0; lane < width; lane++)
                    rows[k * width + lane] += work->rows[k].step;
        }
    }
    int64_t of_input = 0, of_result = 0;
    for (int lane = 0; lane < width; lane++) {
        of_input |= bad[lane];
        of_result |= bad[width + lane];
    }
    return (of_input ? BAD_INPUT : 0) | (of_result ? BAD_RESULT : 0);
}

int64_t run_batch(const job *work, int64_t begin, int64_t end)
{
    if (work->width == 8)
        return run_lanes(work, begin, end, 8);
    if (work->width == 4)
        return run_lanes(work, begin, end, 4);
    return run_lanes(work, begin, end, 2);
}

/* What one thread computes first; `next` is the first state that no thread has taken. */
typedef struct share {
    _Alignas(64) _Atomic int64_t next;
    int64_t end;
    struct threads *threads;
    pthread_t thread;
} share;

struct threads {
    job *work;
    share *shares;
    int64_t count, piece;
};

/* Take pieces of a thread's own share, then of those after it, around. */
static void *run_pieces(void *own)
{
    share *chosen = own;
    struct threads *all = chosen->threads;
    int64_t flags = 0;
    for (int64_t k = 0; k < all->count; k++) {
        for (;;) {
            int64_t begin = atomic_fetch_add_explicit(&chosen->next, all->piece,
                                                      memory_order_relaxed);
            if (begin >= chosen->end)
                break;
            int64_t end = begin + all->piece;
            flags |= run_batch(all->work, begin, end < chosen->end ? end : chosen->end);
        }
        if (++chosen == all->shares + all->count)
            chosen = all->shares;
    }
    atomic_fetch_or_explicit(&all->work->flags, flags, memory_order_relaxed);
    return NULL;
}

/* Run a job in `count` threads, one of which is this one; return when all have ended. Each thread
   computes a share, piece by piece, then pieces that are left of the shares of others: a thread
   that starts late, or whose processor has other work, delays no other, and if threads do not
   start, the others do their work. */
void run_job(job *work, int64_t count)
{
    share *shares = (share *)(((uintptr_t)alloca((size_t)(count + 1) * sizeof(share)) + 63)
                              & ~(uintptr_t)63);
    int64_t size = work->end - work->begin, width = work->width;
    int64_t blocks = (size + width - 1) / width;
    int64_t piece = (size / (count * PIECES) / width + 1) * width;
    struct threads all = {work, shares, count, piece};
    work->flags = 0;
    int64_t begin = work->begin;
    for (int64_t k = 0; k < count; k++) { /* shares of whole blocks of lanes */
        int64_t end = work->begin + blocks * (k + 1) / count * width;
        shares[k].next = begin;
        shares[k].end = end < work->end ? end : work->end;
        shares[k].threads = &all;
        begin = end;
    }
    pthread_attr_t attributes;
    pthread_attr_init(&attributes);
    pthread_attr_setstacksize(&attributes, STACK);
    int64_t started = 1;
    while (started < count && !pthread_create(&shares[started].thread, &attributes, run_pieces,
                                              shares + started))
        started++;
    run_pieces(shares);
    int64_t tries = TRIES;
    for (int64_t k = 1; k < started; k++) {
        while (pthread_tryjoin_np(shares[k].thread, NULL))
            if (tries-- <= 0) {
                pthread_join(shares[k].thread, NULL);
                break;
            }
    }
    pthread_attr_destroy(&attributes);
}

/*
 * XLA calls `handle` with buffers in host memory, by a function that adds the batch's description.
 * The layout is that of xla/ffi/api/c_api.h, major version 0: offsets in bytes below are of its
 * structures. The operands are the arguments of the kernel, each with the entries of one state,
 * which all share, or those of every state; then the bytes of the kernel's parameters. Arguments
 * and result are float64, or float32, which is converted.
 */
typedef struct {
    int64_t *kernel;
    int64_t slots, width;
    int64_t grain; /* states of a thread at least */
    int64_t threads, minor; /* most threads; minor version of XLA's interface */
    int64_t *sizes; /* of each operand and of the result: the entries of a state */
    double *limits; /* of each, the largest valid number */
} described;

enum { METADATA = 1, FLOAT32 = 11 };

static void *pointer_at(void *structure, int64_t offset)
{
    return *(void **)((char *)structure + offset);
}

/* The number of entries of a buffer. */
static int64_t entries(void *buffer)
{
    int64_t rank = *(int64_t *)((char *)buffer + 32), total = 1;
    const int64_t *sizes = pointer_at(buffer, 40);
    for (int64_t k = 0; k < rank; k++)
        total *= sizes[k];
    return total;
}

/* Write NaN to the result of each state with a number beyond the limits. */
static void spoil(const described *batch, const row *rows, int64_t count)
{
    int64_t last = batch->slots - 1;
    for (int64_t i = 0; i < count; i++) {
        int good = 1;
        for (int64_t k = 0; k <= last; k++) {
            const double *x = (const double *)(rows[k].address + i * rows[k].lane);
            for (int64_t j = 0; j < batch->sizes[k]; j++)
                good = good && fabs(x[j]) <= batch->limits[k];
        }
        if (!good)
            memset(rows[last].address + i * rows[last].lane, -1,
                   (size_t)batch->sizes[last] * sizeof(double));
    }
}

void *handle(void *frame, described *batch)
{
    void *extension = pointer_at(frame, 8);
    if (extension && *(int32_t *)((char *)extension + 8) == METADATA) {
        int32_t *metadata = (int32_t *)((char *)pointer_at(extension, 24) + 24);
        metadata[0] = 0; /* the versions of the interface, and no traits */
        metadata[1] = (int32_t)batch->minor;
        metadata[2] = 0;
        return NULL;
    }
    void **arguments = pointer_at(frame, 72);
    void *result = *(void **)pointer_at(frame, 112);
    int64_t last = batch->slots - 1, total = entries(result);
    int64_t count = batch->sizes[last] ? total / batch->sizes[last] : 0;
    if (!count)
        return NULL;
    int single = *(int32_t *)((char *)result + 16) == FLOAT32;
    row rows[POINTER_SLOTS];
    int64_t needed = total;
    for (int64_t k = 0; k < last; k++) {
        int64_t size = batch->sizes[k], given = entries(arguments[k]);
        int shared = given == size || k == last - 1; /* the last one are the parameters */
        rows[k] = (row){pointer_at(arguments[k], 24), shared ? 0 : 8 * size, 0, NULL};
        needed += k < last - 1 ? given : 0;
    }
    rows[last] = (row){pointer_at(result, 24), 8 * batch->sizes[last], 0, NULL};
    double *scratch = NULL;
    if (single) {
        scratch = malloc((size_t)needed * sizeof(double));
        if (!scratch) { /* NaN */
            memset(rows[last].address, -1, (size_t)total * sizeof(float));
            return NULL;
        }
        double *free_part = scratch + total;
        for (int64_t k = 0; k < last - 1; k++) {
            int64_t given = entries(arguments[k]);
            const float *from = (const float *)rows[k].address;
            rows[k].address = (char *)free_part;
            for (int64_t j = 0; j < given; j++)
                *free_part++ = from[j];
        }
        rows[last].address = (char *)scratch;
    }
    int64_t threads = count / batch->grain;
    threads = threads < 1 ? 1 : threads > batch->threads ? batch->threads : threads;
    job work = {batch->kernel, rows, batch->slots, 0, NULL, NULL, 0, count, 1, batch->width, 0};
    run_job(&work, threads);
    if (work.flags)
        spoil(batch, rows, count);
    if (single) {
        float *to = pointer_at(result, 24);
        for (int64_t j = 0; j < total; j++)
            to[j] = (float)scratch[j];
        free(scratch);
    }
    return NULL;
}
