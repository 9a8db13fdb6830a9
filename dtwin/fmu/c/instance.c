#include "instance.h"

#include <float.h>
#include <math.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "constants.h"

#define MESSAGE 512 /* bytes of the longest message */

const char *const log_categories[LOG_CATEGORIES] = {"logStatusDiscard", "logStatusError"};

/* ---- messages ---- */

static void say(struct instance *instance, enum outcome outcome, const char *format, va_list values)
{
    const int category = outcome == OUTCOME_ERROR ? LOG_ERROR : LOG_DISCARD;
    char text[MESSAGE];
    int length;
    if (instance->wishes.logger == NULL || !instance->logged[category]) {
        return;
    }
    length = snprintf(text, sizeof text, "%s: ", instance->function);
    if (length > 0 && (size_t)length < sizeof text) {
        vsnprintf(text + length, sizeof text - (size_t)length, format, values);
        instance->wishes.log(instance, outcome, log_categories[category], text);
    }
}

enum outcome instance_refuse(struct instance *instance, const char *format, ...)
{
    va_list values;
    va_start(values, format);
    say(instance, OUTCOME_ERROR, format, values);
    va_end(values);
    return OUTCOME_ERROR;
}

enum outcome instance_discard(struct instance *instance, const char *format, ...)
{
    va_list values;
    va_start(values, format);
    say(instance, OUTCOME_DISCARD, format, values);
    va_end(values);
    return OUTCOME_DISCARD;
}

static void log_all(struct instance *instance, bool on)
{
    int k;
    for (k = 0; k < LOG_CATEGORIES; ++k) {
        instance->logged[k] = on;
    }
}

static int category_of(const char *name)
{
    int k;
    for (k = 0; name != NULL && k < LOG_CATEGORIES; ++k) {
        if (strcmp(name, log_categories[k]) == 0) {
            return k;
        }
    }
    return -1;
}

enum outcome instance_set_logging(struct instance *instance, bool on, size_t count, const char *const categories[])
{
    size_t k;
    if (count > 0 && categories == NULL) {
        return instance_refuse(instance, "expected the names of log categories, got a null pointer");
    }
    for (k = 0; k < count; ++k) {
        if (category_of(categories[k]) < 0) {
            return instance_refuse(instance, "expected the log category %s or %s, got %.100s", log_categories[LOG_DISCARD],
                                   log_categories[LOG_ERROR], categories[k] == NULL ? "a null pointer" : categories[k]);
        }
    }
    if (count == 0) {
        log_all(instance, on);
    }
    for (k = 0; k < count; ++k) {
        instance->logged[category_of(categories[k])] = on;
    }
    return OUTCOME_OK;
}

/* ---- life ---- */

static bool is_blank(const char *text)
{
    return text == NULL || text[strspn(text, " \t\r\n")] == '\0';
}

static struct instance *refused(struct instance *instance, const char *problem)
{
    log_all(instance, true);
    instance_refuse(instance, "%s", problem);
    return NULL;
}

struct instance *instance_new(const struct wishes *wishes, const char *function)
{
    struct instance *instance, unmade = {0};
    unmade.wishes = *wishes;
    unmade.function = function;
    unmade.name = "";
    if (is_blank(wishes->name)) {
        return refused(&unmade, "expected a name of the instance, got none");
    }
    if (wishes->token == NULL || strcmp(wishes->token, model_token) != 0) {
        return refused(&unmade, "expected a co-simulation with the token of modelDescription.xml");
    }
    instance = calloc(1, sizeof *instance);
    if (instance == NULL) {
        return refused(&unmade, "there is no memory");
    }
    *instance = unmade;
    instance->model = calloc(1, model_size);
    instance->spare = calloc(1, model_size);
    instance->name = calloc(1, strlen(wishes->name) + 1);
    if (instance->model == NULL || instance->spare == NULL || instance->name == NULL) {
        instance_free(instance);
        return refused(&unmade, "there is no memory");
    }
    strcpy(instance->name, wishes->name);
    instance->wishes.name = instance->wishes.token = NULL; /* theirs only during this call */
    instance_reset(instance);
    return instance;
}

void instance_free(struct instance *instance)
{
    if (instance != NULL) {
        instance_free_states(instance);
        free(instance->model);
        free(instance->spare);
        free(instance->name);
        free(instance);
    }
}

void instance_reset(struct instance *instance)
{
    memset(&instance->at, 0, sizeof instance->at);
    instance->at.mode = MODE_INSTANTIATED;
    memset(instance->model, 0, model_size);
    model_reset(instance->model);
    instance->stale = true;
    log_all(instance, instance->wishes.logging);
}

struct instance *instance_called(void *handle, enum call call, const char *function)
{
    struct instance *instance = handle;
    if (instance == NULL) {
        return NULL;
    }
    instance->function = function;
    if (!call_is_allowed(call, instance->wishes.version, (enum mode)instance->at.mode)) {
        instance_refuse(instance, "cannot be called %s", call == CALL_NEVER ? "for this model" : mode_name((enum mode)instance->at.mode));
        return NULL;
    }
    return instance;
}

/* ---- values ---- */

void instance_refresh(struct instance *instance)
{
    if (instance->stale) {
        model_refresh(instance->model);
        instance->stale = false;
    }
}

bool instance_has_arrays(struct instance *instance, size_t count, const void *references, const void *values)
{
    if (count > 0 && (references == NULL || values == NULL)) {
        instance_refuse(instance, "expected value references and values, got a null pointer");
        return false;
    }
    return true;
}

static bool is_known(struct instance *instance, uint32_t reference, enum model_type type)
{
    static const char *const names[] = {"a real", "an integer", "a Boolean", "a text"};
    if (reference >= model_count) {
        instance_refuse(instance, "expected a value reference below %lu, got %lu", (unsigned long)model_count,
                        (unsigned long)reference);
        return false;
    }
    if (model_variables[reference].type != type) {
        instance_refuse(instance, "%s: expected %s variable, got %s one", model_variables[reference].name, names[type],
                        names[model_variables[reference].type]);
        return false;
    }
    return true;
}

enum outcome instance_check_get(struct instance *instance, const uint32_t *references, size_t count,
                                enum model_type type)
{
    size_t k;
    for (k = 0; k < count; ++k) {
        if (!is_known(instance, references[k], type)) {
            return OUTCOME_ERROR;
        }
    }
    instance_refresh(instance);
    return OUTCOME_OK;
}

static char *place_of(struct model *model, uint32_t reference)
{
    return (char *)model + model_variables[reference].offset;
}

void instance_get(struct instance *instance, uint32_t reference, void *value)
{
    const char *place = place_of(instance->model, reference);
    switch (model_variables[reference].type) {
    case MODEL_REAL:
        memcpy(value, place, sizeof(double));
        break;
    case MODEL_INTEGER:
        memcpy(value, place, sizeof(int32_t));
        break;
    case MODEL_BOOLEAN:
        memcpy(value, place, sizeof(bool));
        break;
    case MODEL_TEXTUAL:
        memcpy(value, &place, sizeof place);
        break;
    }
}

static enum outcome check_number(struct instance *instance, const struct model_variable *variable, double number)
{
    if (!(number >= variable->low && number <= variable->high)) {
        return instance_discard(instance, "%s: expected %.15g to %.15g, got %.15g", variable->name, variable->low,
                                variable->high, number);
    }
    return OUTCOME_OK;
}

static enum outcome check_value(struct instance *instance, const struct model_variable *variable, const void *value)
{
    double real;
    int32_t integer;
    unsigned char truth;
    switch (variable->type) {
    case MODEL_REAL:
        memcpy(&real, value, sizeof real);
        return check_number(instance, variable, real);
    case MODEL_INTEGER:
        memcpy(&integer, value, sizeof integer);
        return check_number(instance, variable, integer);
    case MODEL_BOOLEAN:
        memcpy(&truth, value, sizeof truth);
        return truth <= 1 ? OUTCOME_OK : instance_discard(instance, "%s: expected false or true", variable->name);
    case MODEL_TEXTUAL:
        if (value == NULL) {
            return instance_refuse(instance, "%s: expected a text, got a null pointer", variable->name);
        }
        if (strlen(value) >= MODEL_TEXT) {
            return instance_discard(instance, "%s: expected at most %d bytes, got %lu", variable->name, MODEL_TEXT - 1,
                                    (unsigned long)strlen(value));
        }
    }
    return OUTCOME_OK;
}

enum outcome instance_check_set(struct instance *instance, uint32_t reference, enum model_type type, const void *value)
{
    const struct model_variable *variable;
    if (!is_known(instance, reference, type)) {
        return OUTCOME_ERROR;
    }
    variable = &model_variables[reference];
    if (variable->setting == MODEL_NEVER) {
        return instance_refuse(instance, "%s: expected an input or a parameter, got an output", variable->name);
    }
    if (variable->setting == MODEL_BEFORE_START && instance->at.mode > MODE_INITIALIZING) {
        return instance_refuse(instance, "%s: can be set until the initialization ends", variable->name);
    }
    return check_value(instance, variable, value);
}

void instance_set(struct instance *instance, uint32_t reference, const void *value)
{
    char *place = place_of(instance->model, reference);
    instance->stale = true;
    switch (model_variables[reference].type) {
    case MODEL_REAL:
        memcpy(place, value, sizeof(double));
        break;
    case MODEL_INTEGER:
        memcpy(place, value, sizeof(int32_t));
        break;
    case MODEL_BOOLEAN:
        memcpy(place, value, sizeof(bool));
        break;
    case MODEL_TEXTUAL:
        strcpy(place, value);
        break;
    }
}

enum outcome instance_derivative(struct instance *instance, const uint32_t *unknowns, size_t unknown_count,
                                 const uint32_t *knowns, size_t known_count, const double *seed, double *moved)
{
    char *direction, *ends;
    size_t k;
    bool good;
    if (!instance_has_arrays(instance, known_count, knowns, seed) ||
        !instance_has_arrays(instance, unknown_count, unknowns, moved) ||
        instance_check_get(instance, knowns, known_count, MODEL_REAL) != OUTCOME_OK ||
        instance_check_get(instance, unknowns, unknown_count, MODEL_REAL) != OUTCOME_OK) {
        return OUTCOME_ERROR;
    }
    for (k = 0; k < known_count; ++k) {
        if (!isfinite(seed[k])) {
            return instance_refuse(instance, "expected finite seeds, got %g", seed[k]);
        }
    }
    direction = ends = calloc(2, model_size);
    if (ends == NULL) {
        return instance_refuse(instance, "there is no memory");
    }
    for (k = 0; k < known_count; ++k) {
        memcpy(direction + model_variables[knowns[k]].offset, &seed[k], sizeof(double));
    }
    good = model_derivative(instance->model, (const void *)direction, (void *)(ends + model_size));
    for (k = 0; good && k < unknown_count; ++k) {
        memcpy(&moved[k], ends + model_size + model_variables[unknowns[k]].offset, sizeof(double));
    }
    free(ends);
    return good ? OUTCOME_OK : instance_refuse(instance, "this model gives no directional derivatives");
}

/* ---- time ---- */

/* A bound of the rounding of a few sums of times. */
static double rounding_of(const struct instance *instance, double time)
{
    return 4.0 * DBL_EPSILON * fmax(fabs(instance->at.experiment.start), fabs(time));
}

static bool is_time(double time)
{
    return fabs(time) <= FARTHEST_TIME; /* NaN is not */
}

enum outcome instance_set_up(struct instance *instance, const double *tolerance, double start, const double *stop)
{
    struct experiment *experiment = &instance->at.experiment;
    if (tolerance != NULL && !(*tolerance > 0.0 && isfinite(*tolerance))) {
        return instance_refuse(instance, "expected a finite tolerance above 0, got %g", *tolerance);
    }
    if (!is_time(start)) {
        return instance_refuse(instance, "expected a start time of %g to %g s, got %g", -FARTHEST_TIME, FARTHEST_TIME,
                               start);
    }
    if (stop != NULL && !(*stop >= start && *stop <= FARTHEST_TIME)) {
        return instance_refuse(instance, "expected a stop time of %.15g to %g s, got %.15g", start, FARTHEST_TIME, *stop);
    }
    experiment->start = start;
    experiment->stops = stop != NULL;
    experiment->stop = stop != NULL ? *stop : 0.0;
    experiment->is_set = true;
    return OUTCOME_OK;
}

/* Ends a call that the model could not end: the model is what it was. */
static enum outcome failed(struct instance *instance, const char *problem)
{
    struct model *broken = instance->model;
    instance->model = instance->spare;
    instance->spare = broken;
    instance->stale = true;
    instance->at.mode = instance->wishes.version == 2 ? MODE_FAILED : MODE_TERMINATED;
    return instance_refuse(instance, "%s", problem);
}

enum outcome instance_begin(struct instance *instance)
{
    const char *problem = model_check(instance->model);
    if (problem != NULL) {
        return instance_refuse(instance, "%s", problem);
    }
    model_copy(instance->spare, instance->model);
    instance->at.time = instance->at.experiment.start;
    problem = model_begin(instance->model, instance->at.time);
    if (problem != NULL) {
        return failed(instance, problem);
    }
    instance->stale = true;
    instance->at.mode = instance->wishes.has_event_mode ? MODE_EVENT : MODE_STEPPING;
    return OUTCOME_OK;
}

/* Whether a step is the next one: it begins where the last one ended, except for what a simulator's sum of times has
 * lost by rounding, and ends before the experiment does. */
static enum outcome check_step(struct instance *instance, double time, double duration)
{
    const struct progress *at = &instance->at;
    const double now = at->experiment.start + at->elapsed, rounding = rounding_of(instance, now + duration);
    const double lost = TIME_ROUNDING + (1.0 + (double)at->steps) * rounding;
    if (!(duration > 0.0 && duration <= LONGEST_DURATION)) {
        return instance_refuse(instance, "expected a communication step above 0 and up to %g s, got %g", LONGEST_DURATION,
                               duration);
    }
    if (!(fabs(time - now) <= lost)) {
        return instance_refuse(instance, "expected the communication point %.15g s, got %.15g", now, time);
    }
    if (!is_time(time + duration)) {
        return instance_refuse(instance, "expected a step that ends at %g s at most, got %.15g", FARTHEST_TIME,
                               time + duration);
    }
    if (at->experiment.stops && time + duration > at->experiment.stop + lost) {
        return instance_refuse(instance, "expected a step that ends by the stop time %.15g s, got %.15g",
                               at->experiment.stop, time + duration);
    }
    return OUTCOME_OK;
}

/* A sum without loss (Kahan). */
static void add(struct progress *at, double duration)
{
    const double part = duration + at->remainder, sum = at->elapsed + part;
    at->remainder = part - (sum - at->elapsed);
    at->elapsed = sum;
}

enum outcome instance_step(struct instance *instance, double time, double duration)
{
    const char *problem;
    uint64_t before;
    if (check_step(instance, time, duration) != OUTCOME_OK) {
        return OUTCOME_ERROR;
    }
    problem = model_check(instance->model);
    if (problem != NULL) {
        return instance_refuse(instance, "%s", problem);
    }
    instance_refresh(instance);
    before = model_events(instance->model);
    model_copy(instance->spare, instance->model);
    problem = model_step(instance->model, time + duration, duration, rounding_of(instance, time + duration));
    if (problem != NULL) {
        return failed(instance, problem);
    }
    instance->stale = false;
    instance->at.time = time + duration;
    instance->at.event = model_events(instance->model) != before;
    ++instance->at.steps;
    add(&instance->at, duration);
    return OUTCOME_OK;
}
