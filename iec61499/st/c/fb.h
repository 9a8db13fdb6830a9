/* What the C code of function blocks calls: the semantics of Structured Text, bit for bit those of dtwin's Python
 * runtime, and the queue of events of a resource.
 *
 * C99 without allocation. Compile with -ffp-contract=off and without fast-math; the elementary functions are those of
 * the libm that is linked. A text has at most FB_TEXT bytes and a queue FB_WAITING events: what needs more is a fault.
 */
#ifndef DTWIN_FB_H
#define DTWIN_FB_H

#include <float.h>
#include <inttypes.h>
#include <math.h>
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#if FLT_EVAL_METHOD != 0
#error "expected a compiler that rounds every operation to its type: on 32-bit x86 compile with -msse2 -mfpmath=sse"
#endif

#if defined(__GNUC__)
/* programs may compare an unsigned variable with 0 */
#pragma GCC diagnostic ignored "-Wtype-limits"
#endif

#define FB_TEXT 254
#ifndef FB_WAITING
#define FB_WAITING 1024 /* a unit with many connections has more */
#endif
#ifndef FB_TIMERS
#define FB_TIMERS 1 /* timed blocks of the unit */
#endif
#define FB_TICK 1000000 /* shortest delay of a timed block, ns */
#define FB_EVENTS 100000
#define FB_ITERATIONS 10000000
#define FB_TRANSITIONS 10000

enum fb_problem {
    FB_FINE = 0,
    FB_INDEX = 1,          /* an index out of range */
    FB_ENDLESS_LOOP = 2,   /* a loop that uses up the iterations of the chain of events */
    FB_NO_STEP = 3,        /* FOR ... BY 0 */
    FB_LONG_TEXT = 4,      /* a text longer than FB_TEXT */
    FB_ENDLESS_CHART = 5,  /* a chart that never comes to rest */
    FB_ENDLESS_EVENTS = 6, /* a chain of events that does not end */
    FB_FULL_QUEUE = 7,     /* more than FB_WAITING events wait */
    FB_NOT_OPEN = 8,       /* a message to a SERVER that is not initialised */
    FB_NO_ANSWER = 9,      /* a message that was not answered exactly once */
    FB_CHARACTER = 10,     /* a character that is not in the text */
    FB_HOST = 11           /* a service of the host that failed, or that there is no host for */
};

struct fb_fault {
    int32_t problem; /* of enum fb_problem */
    int32_t place;   /* number of the place in the source */
    int64_t value;   /* the index, the character's place, or the number of answers */
    int64_t low;
    int64_t high;
    int32_t event; /* number of the event that was delivered */
};

/* What a timed block waits for: its event, and whose turn it is of those that are due together. */
struct fb_timer {
    int64_t due; /* ns */
    int64_t order;
    uint16_t block;
};

struct fb_run {
    struct fb_fault fault;
    int64_t time;                   /* the clock of the timers, ns; whoever delivers events moves it on */
    int32_t (*host)(int32_t entry); /* does what a service of the host does at an event; 0 when it could */
    uint32_t iterations;            /* of loops that the chain of events may still use */
    uint16_t head;
    uint16_t waiting;
    uint16_t queue[FB_WAITING];
    uint32_t timers; /* that wait, in a heap */
    int64_t order;
    struct fb_timer heap[FB_TIMERS];
};

/* A STRING: the bytes of its UTF-8 text, without an end mark. */
struct fb_string {
    uint16_t length;
    char text[FB_TEXT];
};

/* A text somewhere else. */
struct fb_text {
    uint16_t length;
    const char *start;
};

/* A variable of a unit: NAME.VARIABLE and where it is. */
struct fb_variable {
    const char *name;
    const char *type;
    size_t offset;
    size_t size;
};

/* A place in the source of a block. */
struct fb_place {
    const char *file;
    int32_t line;
    int32_t column;
};

/* ---- faults and events ---- */

static inline bool fb_fine(const struct fb_run *run)
{
    return run->fault.problem == FB_FINE;
}

/* The first fault counts. */
static inline void fb_fail(struct fb_run *run, enum fb_problem problem, int32_t place)
{
    if (fb_fine(run)) {
        run->fault.problem = (int32_t)problem;
        run->fault.place = place;
    }
}

/* How far a value is from the lowest one of a range; a problem when it is not in the range. */
static inline size_t fb_within(struct fb_run *run, int64_t value, int64_t low, int64_t high, enum fb_problem problem,
                               int32_t place)
{
    if (value >= low && value <= high) {
        return (size_t)(value - low);
    }
    if (fb_fine(run)) {
        run->fault.value = value;
        run->fault.low = low;
        run->fault.high = high;
    }
    fb_fail(run, problem, place);
    return 0;
}

static inline size_t fb_index(struct fb_run *run, int64_t value, int64_t low, int64_t high, int32_t place)
{
    return fb_within(run, value, low, high, FB_INDEX, place);
}

/* Whether a loop may go on. */
static inline bool fb_again(struct fb_run *run, int32_t place)
{
    if (run->iterations == 0) {
        fb_fail(run, FB_ENDLESS_LOOP, place);
    } else {
        --run->iterations;
    }
    return fb_fine(run);
}

/* How often a FOR loop goes round; more than it may is as good as any number. */
static inline uint64_t fb_rounds_unsigned(uint64_t start, uint64_t stop, uint64_t step)
{
    uint64_t rounds;
    if (start > stop) {
        return 0;
    }
    rounds = (stop - start) / step;
    return rounds == UINT64_MAX ? rounds : rounds + 1;
}

static inline uint64_t fb_rounds_signed(int64_t start, int64_t stop, int64_t step)
{
    const uint64_t half = (uint64_t)1 << 63;
    if (step > 0) {
        return fb_rounds_unsigned((uint64_t)start ^ half, (uint64_t)stop ^ half, (uint64_t)step);
    }
    return fb_rounds_unsigned((uint64_t)stop ^ half, (uint64_t)start ^ half, 0u - (uint64_t)step);
}

static inline void fb_push(struct fb_run *run, uint16_t entry)
{
    if (run->waiting == FB_WAITING) {
        fb_fail(run, FB_FULL_QUEUE, 0);
        return;
    }
    run->queue[(size_t)(run->head + run->waiting) % FB_WAITING] = entry;
    ++run->waiting;
}

static inline uint16_t fb_pop(struct fb_run *run)
{
    uint16_t entry = run->queue[run->head];
    run->head = (uint16_t)((run->head + 1) % FB_WAITING);
    --run->waiting;
    return entry;
}

/* Lets the host do what a service does at the event that is delivered. */
static inline void fb_ask(struct fb_run *run)
{
    if (run->host == NULL || run->host(run->fault.event) != 0) {
        fb_fail(run, FB_HOST, 0);
    }
}

/* ---- timers ---- */

static inline bool fb_sooner(const struct fb_timer *a, const struct fb_timer *b)
{
    return a->due < b->due || (a->due == b->due && a->order < b->order);
}

/* Puts a timer to where it belongs in the heap, from an empty place on. */
static inline void fb_place(struct fb_run *run, uint32_t k, struct fb_timer timer)
{
    uint32_t child;
    while (k > 0 && fb_sooner(&timer, &run->heap[(k - 1) / 2])) {
        run->heap[k] = run->heap[(k - 1) / 2];
        k = (k - 1) / 2;
    }
    for (child = 2 * k + 1; child < run->timers; child = 2 * k + 1) {
        if (child + 1 < run->timers && fb_sooner(&run->heap[child + 1], &run->heap[child])) {
            ++child;
        }
        if (!fb_sooner(&run->heap[child], &timer)) {
            break;
        }
        run->heap[k] = run->heap[child];
        k = child;
    }
    run->heap[k] = timer;
}

/* Lets a timed block, which does not wait, have its event after a time, but no sooner than in a tick. */
static inline void fb_schedule(struct fb_run *run, uint16_t block, int64_t delay)
{
    struct fb_timer timer;
    const int64_t most = INT64_MAX - run->time;
    delay = delay > FB_TICK ? delay : FB_TICK;
    timer.due = run->time + (delay < most ? delay : most);
    timer.order = run->order++;
    timer.block = block;
    ++run->timers;
    fb_place(run, run->timers - 1, timer);
}

static inline void fb_remove(struct fb_run *run, uint32_t k)
{
    const struct fb_timer last = run->heap[--run->timers];
    if (k < run->timers) {
        fb_place(run, k, last);
    }
}

/* Lets a timed block wait no longer. */
static inline void fb_cancel(struct fb_run *run, uint16_t block)
{
    uint32_t k;
    for (k = 0; k < run->timers; ++k) {
        if (run->heap[k].block == block) {
            fb_remove(run, k);
            return;
        }
    }
}

/* ---- numbers ---- */

static inline double fb_divide(double a, double b)
{
    if (b == 0.0) {
        if (a == 0.0 || isnan(a)) {
            return (double)NAN;
        }
        return copysign((double)INFINITY, a) * copysign(1.0, b);
    }
    return a / b;
}

/* x ** 2 is x * x, from which pow differs in the last bit. */
static inline double fb_power(double a, double b)
{
    double result;
    if (b == 2.0) {
        return a * a;
    }
    result = pow(a, b);
    return isnan(result) && !isnan(a) && !isnan(b) ? (double)NAN : result;
}

static inline double fb_sqrt(double x) { return x < 0.0 ? (double)NAN : sqrt(x); }
static inline double fb_exp(double x) { return exp(x); }
static inline double fb_sin(double x) { return isinf(x) ? (double)NAN : sin(x); }
static inline double fb_cos(double x) { return isinf(x) ? (double)NAN : cos(x); }
static inline double fb_tan(double x) { return isinf(x) ? (double)NAN : tan(x); }
static inline double fb_asin(double x) { return fabs(x) > 1.0 ? (double)NAN : asin(x); }
static inline double fb_acos(double x) { return fabs(x) > 1.0 ? (double)NAN : acos(x); }
static inline double fb_atan(double x) { return atan(x); }
static inline double fb_atan2(double y, double x) { return atan2(y, x); }

static inline double fb_ln(double x)
{
    return x == 0.0 ? -(double)INFINITY : x < 0.0 ? (double)NAN : log(x);
}

static inline double fb_log(double x)
{
    return x == 0.0 ? -(double)INFINITY : x < 0.0 ? (double)NAN : log10(x);
}

static inline double fb_min_real(double a, double b) { return a < b ? a : b; }
static inline double fb_max_real(double a, double b) { return a > b ? a : b; }
static inline int64_t fb_min_signed(int64_t a, int64_t b) { return a < b ? a : b; }
static inline int64_t fb_max_signed(int64_t a, int64_t b) { return a > b ? a : b; }
static inline uint64_t fb_min_unsigned(uint64_t a, uint64_t b) { return a < b ? a : b; }
static inline uint64_t fb_max_unsigned(uint64_t a, uint64_t b) { return a > b ? a : b; }

static inline int64_t fb_abs(int64_t x)
{
    return x < 0 ? (int64_t)(0u - (uint64_t)x) : x;
}

static inline int64_t fb_clamp(uint64_t x)
{
    return x > (uint64_t)INT64_MAX ? INT64_MAX : (int64_t)x;
}

/* Truncated toward zero; 0 when b is 0. */
static inline int64_t fb_divide_signed(int64_t a, int64_t b)
{
    return b == 0 ? 0 : b == -1 ? (int64_t)(0u - (uint64_t)a) : a / b;
}

static inline uint64_t fb_divide_unsigned(uint64_t a, uint64_t b) { return b == 0 ? 0 : a / b; }

/* The sign of a; 0 when b is 0. */
static inline int64_t fb_modulo_signed(int64_t a, int64_t b) { return b == 0 || b == -1 ? 0 : a % b; }
static inline uint64_t fb_modulo_unsigned(uint64_t a, uint64_t b) { return b == 0 ? 0 : a % b; }

static inline uint64_t fb_raise(uint64_t base, uint64_t exponent)
{
    uint64_t result = 1;
    while (exponent > 0) {
        if (exponent & 1u) {
            result *= base;
        }
        base *= base;
        exponent >>= 1;
    }
    return result;
}

/* A negative exponent gives what an integer division of 1 would. */
static inline int64_t fb_raise_signed(int64_t base, int64_t exponent)
{
    if (exponent < 0) {
        return base == 1 || base == -1 ? (exponent % 2 != 0 ? base : 1) : 0;
    }
    return (int64_t)fb_raise((uint64_t)base, (uint64_t)exponent);
}

/* The largest base is no -1. */
static inline uint64_t fb_raise_unsigned(uint64_t base, int64_t exponent)
{
    return exponent < 0 ? base == 1 : fb_raise(base, (uint64_t)exponent);
}

/* Toward zero; what does not fit 64 bit, or is NaN, is -2^63, as on x86-64. */
static inline int64_t fb_truncate(double x)
{
    return x >= -9223372036854775808.0 && x < 9223372036854775808.0 ? (int64_t)x : INT64_MIN;
}

static inline uint64_t fb_truncate_unsigned(double x)
{
    return x >= 9223372036854775808.0 && x < 18446744073709551616.0 ? (uint64_t)x : (uint64_t)fb_truncate(x);
}

/* The nearest integer, of two the even one, whatever the rounding of the processor is set to. */
static inline double fb_half_even(double x)
{
    const double whole = floor(x), rest = x - whole;
    return rest < 0.5 || (rest == 0.5 && fmod(whole, 2.0) == 0.0) ? whole : whole + 1.0;
}

/* A duration by an unsigned number; 0 when that is 0. */
static inline int64_t fb_time_divide_unsigned(int64_t a, uint64_t b)
{
    if (b <= (uint64_t)INT64_MAX) {
        return fb_divide_signed(a, (int64_t)b);
    }
    return a == INT64_MIN && b == (uint64_t)1 << 63 ? -1 : 0;
}

static inline int64_t fb_time_scale(int64_t a, double factor) { return fb_truncate((double)a * factor); }
static inline int64_t fb_time_divide_real(int64_t a, double b) { return b == 0.0 ? 0 : fb_truncate((double)a / b); }

/* Since midnight, ns. */
static inline int64_t fb_time_of_day(int64_t x)
{
    const int64_t day = INT64_C(86400000000000);
    int64_t rest = x % day;
    return rest < 0 ? rest + day : rest;
}

static inline uint64_t fb_shift_left(uint64_t x, int64_t count, int bits)
{
    return count < 0 || count >= bits ? 0 : x << count;
}

static inline uint64_t fb_shift_right(uint64_t x, int64_t count, int bits)
{
    return count < 0 || count >= bits ? 0 : x >> count;
}

static inline uint64_t fb_rotate_left(uint64_t x, int64_t count, int bits)
{
    if (count < 0) {
        return 0;
    }
    count %= bits;
    return count == 0 ? x : x << count | x >> (bits - count);
}

static inline uint64_t fb_rotate_right(uint64_t x, int64_t count, int bits)
{
    return count < 0 ? 0 : fb_rotate_left(x, (bits - count % bits) % bits, bits);
}

/* A nibble for every decimal digit; those beyond 64 bit are lost. */
static inline uint64_t fb_to_decimal(uint64_t value)
{
    uint64_t result = 0;
    int place;
    for (place = 0; place < 64; place += 4) {
        result |= value % 10 << place;
        value /= 10;
    }
    return result;
}

static inline uint64_t fb_from_decimal(uint64_t value)
{
    uint64_t result = 0;
    int place;
    for (place = 60; place >= 0; place -= 4) {
        result = result * 10 + (value >> place & 15u);
    }
    return result;
}

static inline uint32_t fb_bits_of_float(float x)
{
    uint32_t bits;
    memcpy(&bits, &x, sizeof bits);
    return bits;
}

static inline uint64_t fb_bits_of_double(double x)
{
    uint64_t bits;
    memcpy(&bits, &x, sizeof bits);
    return bits;
}

static inline float fb_float_of(uint32_t bits)
{
    float x;
    memcpy(&x, &bits, sizeof x);
    return x;
}

static inline double fb_double_of(uint64_t bits)
{
    double x;
    memcpy(&x, &bits, sizeof x);
    return x;
}

/* ---- texts ---- */

static inline struct fb_text fb_literal(const char *start, uint16_t length)
{
    struct fb_text text;
    text.length = length;
    text.start = start;
    return text;
}

static inline struct fb_text fb_view(const struct fb_string *string) { return fb_literal(string->text, string->length); }

static inline void fb_assign(struct fb_string *string, struct fb_text text)
{
    memmove(string->text, text.start, text.length);
    string->length = text.length;
}

static inline void fb_copy(struct fb_string *to, const struct fb_string *from)
{
    memcpy(to->text, from->text, from->length);
    to->length = from->length;
}

static inline struct fb_text fb_cut(struct fb_text text, uint16_t limit)
{
    return fb_literal(text.start, text.length < limit ? text.length : limit);
}

static inline bool fb_equal(struct fb_text a, struct fb_text b)
{
    return a.length == b.length && memcmp(a.start, b.start, a.length) == 0;
}

static inline int fb_compare(struct fb_text a, struct fb_text b)
{
    int order = memcmp(a.start, b.start, a.length < b.length ? a.length : b.length);
    return order != 0 ? order : (int)a.length - (int)b.length;
}

static inline struct fb_text fb_min_text(struct fb_text a, struct fb_text b) { return fb_compare(a, b) < 0 ? a : b; }
static inline struct fb_text fb_max_text(struct fb_text a, struct fb_text b) { return fb_compare(a, b) > 0 ? a : b; }

/* Three texts one behind the other. */
static inline struct fb_text fb_join(struct fb_run *run, struct fb_string *to, struct fb_text a, struct fb_text b,
                                     struct fb_text c, int32_t place)
{
    size_t length = (size_t)a.length + b.length + c.length;
    if (length > FB_TEXT) {
        fb_fail(run, FB_LONG_TEXT, place);
        return a;
    }
    memcpy(to->text, a.start, a.length);
    memcpy(to->text + a.length, b.start, b.length);
    memcpy(to->text + a.length + b.length, c.start, c.length);
    to->length = (uint16_t)length;
    return fb_view(to);
}

static inline struct fb_text fb_concat(struct fb_run *run, struct fb_string *to, struct fb_text a, struct fb_text b,
                                       int32_t place)
{
    return fb_join(run, to, a, b, fb_literal(a.start, 0), place);
}

/* The bytes from a place up to another one, as far as there are any. */
static inline struct fb_text fb_part(struct fb_text text, int64_t from, int64_t to)
{
    if (from > text.length) {
        from = text.length;
    }
    if (to > text.length) {
        to = text.length;
    }
    return fb_literal(text.start + from, (uint16_t)(to > from ? to - from : 0));
}

static inline struct fb_text fb_left(struct fb_text text, int64_t length)
{
    return length < 0 ? text : fb_part(text, 0, length);
}

static inline struct fb_text fb_right(struct fb_text text, int64_t length)
{
    return length < 0 || length > text.length ? text : fb_part(text, text.length - length, text.length);
}

static inline struct fb_text fb_mid(struct fb_text text, int64_t length, int64_t position)
{
    if (length < 0 || position <= 0) {
        return text;
    }
    return fb_part(text, position - 1, length < FB_TEXT ? fb_min_signed(position, FB_TEXT + 1) - 1 + length : FB_TEXT);
}

static inline struct fb_text fb_insert(struct fb_run *run, struct fb_string *to, struct fb_text text,
                                       struct fb_text addition, int64_t position, int32_t place)
{
    if (position < 0 || position > text.length) {
        return text;
    }
    return fb_join(run, to, fb_part(text, 0, position), addition, fb_part(text, position, text.length), place);
}

static inline struct fb_text fb_replace(struct fb_run *run, struct fb_string *to, struct fb_text text,
                                        struct fb_text addition, int64_t length, int64_t position, int32_t place)
{
    if (length < 0 || length > text.length || position < 1 || position - 1 > text.length - length) {
        return text;
    }
    return fb_join(run, to, fb_part(text, 0, position - 1), addition,
                   fb_part(text, position - 1 + length, text.length), place);
}

static inline struct fb_text fb_delete(struct fb_run *run, struct fb_string *to, struct fb_text text, int64_t length,
                                       int64_t position, int32_t place)
{
    return fb_replace(run, to, text, fb_literal(text.start, 0), length, position, place);
}

/* 1-based, 0 when it is not there. */
static inline int32_t fb_find(struct fb_text text, struct fb_text part)
{
    int32_t from;
    for (from = 0; from + (int32_t)part.length <= (int32_t)text.length; ++from) {
        if (memcmp(text.start + from, part.start, part.length) == 0) {
            return from + 1;
        }
    }
    return 0;
}

/* The character at a 1-based place. */
static inline uint8_t fb_character(struct fb_run *run, struct fb_text text, int64_t position, int32_t place)
{
    const size_t offset = fb_within(run, position, 1, text.length, FB_CHARACTER, place);
    return fb_fine(run) ? (uint8_t)text.start[offset] : 0;
}

/* The text with another character at a 1-based place. */
static inline struct fb_text fb_with_character(struct fb_run *run, struct fb_string *to, struct fb_text text,
                                               int64_t position, uint8_t character, int32_t place)
{
    const size_t offset = fb_within(run, position, 1, text.length, FB_CHARACTER, place);
    if (fb_fine(run)) {
        memcpy(to->text, text.start, text.length);
        to->text[offset] = (char)character;
        to->length = text.length;
        return fb_view(to);
    }
    return text;
}

static inline struct fb_text fb_of_char(struct fb_string *to, uint8_t character)
{
    to->text[0] = (char)character;
    to->length = 1;
    return fb_view(to);
}

static inline uint8_t fb_first_char(struct fb_text text) { return text.length == 0 ? 0 : (uint8_t)text.start[0]; }

static inline struct fb_text fb_of_signed(struct fb_string *to, int64_t value)
{
    to->length = (uint16_t)snprintf(to->text, FB_TEXT, "%" PRId64, value);
    return fb_view(to);
}

static inline struct fb_text fb_of_unsigned(struct fb_string *to, uint64_t value)
{
    to->length = (uint16_t)snprintf(to->text, FB_TEXT, "%" PRIu64, value);
    return fb_view(to);
}

static inline struct fb_text fb_of_bool(bool value)
{
    return value ? fb_literal("TRUE", 4) : fb_literal("FALSE", 5);
}

static inline struct fb_text fb_of_real(struct fb_string *to, double value, int digits)
{
    if (isnan(value)) {
        return fb_literal("nan", 3);
    }
    to->length = (uint16_t)snprintf(to->text, FB_TEXT, "%.*g", digits, value);
    return fb_view(to);
}

static inline struct fb_text fb_of_time(struct fb_string *to, int64_t value)
{
    uint64_t micro = (value < 0 ? 0u - (uint64_t)value : (uint64_t)value) / 1000u;
    const char *sign = value < 0 && micro != 0 ? "-" : "";
    int length = micro % 1000u != 0
                     ? snprintf(to->text, FB_TEXT, "T#%s%" PRIu64 ".%03" PRIu64 "ms", sign, micro / 1000u, micro % 1000u)
                     : snprintf(to->text, FB_TEXT, "T#%s%" PRIu64 "ms", sign, micro / 1000u);
    to->length = (uint16_t)length;
    return fb_view(to);
}

static inline bool fb_blank(char c)
{
    unsigned char u = (unsigned char)c;
    return (u >= 9 && u <= 13) || (u >= 28 && u <= 32) || u == 0x85 || u == 0xA0;
}

static inline int fb_digit(char c)
{
    return c >= '0' && c <= '9' ? c - '0' : c >= 'a' && c <= 'f' ? c - 'a' + 10 : c >= 'A' && c <= 'F' ? c - 'A' + 10 : 99;
}

/* The number that the text begins with, as `string_to_integer` of the Python runtime reads it; else 0. */
static inline uint64_t fb_to_integer(struct fb_text text, int bits, bool is_signed, struct fb_text type)
{
    const uint64_t mask = bits == 64 ? UINT64_MAX : ((uint64_t)1 << bits) - 1;
    const char *c = text.start, *end = text.start + text.length, *sharp;
    uint64_t value = 0, most;
    int base = 10;
    bool negative = false;
    sharp = text.length == 0 ? NULL : (const char *)memchr(c, '#', text.length);
    if (sharp != NULL && !(*c >= '0' && *c <= '9')) {
        if (!fb_equal(fb_literal(c, (uint16_t)(sharp - c)), type)) {
            return 0;
        }
        c = sharp + 1;
    }
    if (end - c >= 3 && c[2] == '#') {
        base = c[0] == '1' && c[1] == '0' ? 10 : c[0] == '1' && c[1] == '6' ? 16 : 0;
        c += 3;
    } else if (end - c >= 2 && c[1] == '#') {
        base = c[0] == '2' ? 2 : c[0] == '8' ? 8 : 0;
        c += 2;
    }
    if (base == 0) {
        return 0;
    }
    while (c < end && fb_blank(*c)) {
        ++c;
    }
    if (is_signed && base == 10 && c < end && (*c == '+' || *c == '-')) {
        negative = *c == '-';
        ++c;
    }
    most = !is_signed || base != 10 ? mask : mask / 2 + (negative ? 1u : 0u);
    for (; c < end && fb_digit(*c) < base; ++c) {
        const uint64_t digit = (uint64_t)fb_digit(*c);
        if (value > (most - digit) / (uint64_t)base) {
            return 0;
        }
        value = value * (uint64_t)base + digit;
    }
    return negative ? 0u - value : value;
}

/* The leading number; 0 when there is none. */
static inline double fb_to_real(struct fb_text text)
{
    char number[FB_TEXT + 1];
    size_t from = 0, to, digits = 0;
    while (from < text.length && fb_blank(text.start[from])) {
        ++from;
    }
    to = from;
    if (to < text.length && (text.start[to] == '+' || text.start[to] == '-')) {
        ++to;
    }
    for (; to < text.length && fb_digit(text.start[to]) < 10; ++to) {
        ++digits;
    }
    if (to < text.length && text.start[to] == '.' &&
        (digits > 0 || (to + 1 < text.length && fb_digit(text.start[to + 1]) < 10))) {
        ++digits;
        for (++to; to < text.length && fb_digit(text.start[to]) < 10; ++to) {
        }
    }
    if (digits == 0) {
        return 0.0;
    }
    if (to < text.length && (text.start[to] == 'e' || text.start[to] == 'E')) {
        size_t power = to + 1;
        if (power < text.length && (text.start[power] == '+' || text.start[power] == '-')) {
            ++power;
        }
        if (power < text.length && fb_digit(text.start[power]) < 10) {
            for (to = power; to < text.length && fb_digit(text.start[to]) < 10; ++to) {
            }
        }
    }
    memcpy(number, text.start + from, to - from);
    number[to - from] = '\0';
    return strtod(number, NULL);
}

/* Whether the text begins with TRUE or 1, also behind BOOL#. */
static inline bool fb_to_bool(struct fb_text text)
{
    static const char upper[] = "TRUE", lower[] = "true";
    size_t k;
    if (text.length >= 5 && memcmp(text.start, "BOOL#", 5) == 0) {
        text = fb_part(text, 5, text.length);
    }
    if (text.length > 0 && text.start[0] == '1') {
        return true;
    }
    if (text.length < 4) {
        return false;
    }
    for (k = 0; k < 4; ++k) {
        if (text.start[k] != upper[k] && text.start[k] != lower[k]) {
            return false;
        }
    }
    return true;
}

#endif
