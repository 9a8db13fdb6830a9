#include "instance.h"

#include <stdlib.h>
#include <string.h>

#define TOKEN 40 /* bytes of a snapshot that name the model */

struct instance *instance_new(const char *token, const char *name)
{
    struct instance *instance;
    if (token == NULL || strcmp(token, model_token) != 0) {
        return NULL;
    }
    instance = calloc(1, sizeof *instance);
    if (instance == NULL) {
        return NULL;
    }
    instance->model = calloc(1, model_size);
    instance->name = calloc(1, strlen(name == NULL ? "" : name) + 1);
    if (instance->model == NULL || instance->name == NULL) {
        instance_free(instance);
        return NULL;
    }
    strcpy(instance->name, name == NULL ? "" : name);
    instance_reset(instance);
    return instance;
}

void instance_free(struct instance *instance)
{
    if (instance != NULL) {
        free(instance->model);
        free(instance->name);
        free(instance);
    }
}

static bool failed(struct instance *instance, const char *message)
{
    instance->tell(instance, message);
    return false;
}

static void refresh(struct instance *instance)
{
    if (instance->stale) {
        model_refresh(instance->model);
        instance->stale = false;
    }
}

bool instance_get(struct instance *instance, uint32_t reference, enum model_type type, void *value)
{
    const char *place;
    if (reference >= model_count || model_variables[reference].type != type) {
        return failed(instance, "there is no variable of this type with this value reference");
    }
    refresh(instance);
    place = (const char *)instance->model + model_variables[reference].offset;
    switch (type) {
    case MODEL_REAL:
        memcpy(value, place, sizeof(double));
        break;
    case MODEL_INTEGER:
        memcpy(value, place, sizeof(int32_t));
        break;
    case MODEL_BOOLEAN:
        memcpy(value, place, sizeof(bool));
        break;
    default:
        memcpy(value, &place, sizeof place);
    }
    return true;
}

bool instance_set(struct instance *instance, uint32_t reference, enum model_type type, const void *value)
{
    const struct model_variable *variable;
    char *place;
    if (reference >= model_count || model_variables[reference].type != type) {
        return failed(instance, "there is no variable of this type with this value reference");
    }
    variable = &model_variables[reference];
    if (variable->setting == MODEL_NEVER) {
        return failed(instance, "the variable cannot be set");
    }
    if (variable->setting == MODEL_BEFORE_START && instance->mode > MODE_INITIALIZING) {
        return failed(instance, "the variable can be set until the initialization ends");
    }
    place = (char *)instance->model + variable->offset;
    instance->stale = true;
    switch (type) {
    case MODEL_REAL:
        memcpy(place, value, sizeof(double));
        break;
    case MODEL_INTEGER:
        memcpy(place, value, sizeof(int32_t));
        break;
    case MODEL_BOOLEAN:
        memcpy(place, value, sizeof(bool));
        break;
    default:
        if (strlen(value) >= MODEL_TEXT) {
            return failed(instance, "the text is too long");
        }
        strcpy(place, value);
    }
    return true;
}

void instance_reset(struct instance *instance)
{
    model_reset(instance->model);
    instance->mode = MODE_INSTANTIATED;
    instance->stale = true;
}

bool instance_begin(struct instance *instance)
{
    const char *problem = model_begin(instance->model, instance->start_time);
    instance->mode = MODE_STEPPING;
    instance->stale = true;
    return problem == NULL || failed(instance, problem);
}

/* The outputs whose changes are events, as the bits of a number. */
static uint64_t events_of(struct instance *instance)
{
    uint64_t bits = 0;
    size_t k;
    refresh(instance);
    for (k = 0; k < model_count; ++k) {
        if (model_variables[k].event) {
            const bool *place = (const void *)((const char *)instance->model + model_variables[k].offset);
            bits = (bits << 1) | *place;
        }
    }
    return bits;
}

bool instance_step(struct instance *instance, double time, double duration)
{
    const char *problem;
    uint64_t before;
    if (instance->mode != MODE_STEPPING) {
        return failed(instance, "a step can be done in step mode: after the initialization, before the end");
    }
    if (!(duration >= 0.0)) {
        return failed(instance, "expected a communication step of at least 0 s");
    }
    before = events_of(instance);
    problem = model_step(instance->model, time, duration);
    instance->stale = true;
    instance->event = events_of(instance) != before;
    return problem == NULL || failed(instance, problem);
}

size_t instance_size(void)
{
    return TOKEN + 1 + model_size;
}

static bool is_own(const void *bytes, size_t size)
{
    return bytes != NULL && size == instance_size() && strncmp(bytes, model_token, TOKEN) == 0;
}

bool instance_load(struct instance *instance, const void *bytes, size_t size)
{
    const char *from = bytes;
    if (!is_own(bytes, size)) {
        return failed(instance, "the state is not one of this model");
    }
    instance->mode = (enum mode)from[TOKEN];
    memcpy(instance->model, from + TOKEN + 1, model_size);
    instance->stale = true;
    return true;
}

static bool is_room(void **state)
{
    if (*state == NULL) {
        *state = malloc(instance_size());
    }
    return *state != NULL;
}

bool instance_snapshot(const struct instance *instance, void **state)
{
    char *to;
    if (!is_room(state)) {
        return false;
    }
    to = *state;
    memset(to, 0, TOKEN);
    strncpy(to, model_token, TOKEN - 1);
    to[TOKEN] = (char)instance->mode;
    memcpy(to + TOKEN + 1, instance->model, model_size);
    return true;
}

bool instance_unpack(struct instance *instance, const void *bytes, size_t size, void **state)
{
    if (!is_own(bytes, size)) {
        return failed(instance, "the state is not one of this model");
    }
    if (!is_room(state)) {
        return false;
    }
    memcpy(*state, bytes, size);
    return true;
}

bool instance_derivative(struct instance *instance, const uint32_t *unknowns, size_t unknown_count,
                         const uint32_t *knowns, size_t known_count, const double *seed, double *moved)
{
    char *ends = calloc(2, model_size), *direction = ends;
    size_t k;
    bool good = ends != NULL;
    for (k = 0; good && k < known_count; ++k) {
        good = knowns[k] < model_count && model_variables[knowns[k]].type == MODEL_REAL;
        if (good) {
            memcpy(direction + model_variables[knowns[k]].offset, &seed[k], sizeof(double));
        }
    }
    refresh(instance);
    good = good && model_derivative(instance->model, (const void *)direction, (void *)(ends + model_size));
    for (k = 0; good && k < unknown_count; ++k) {
        good = unknowns[k] < model_count && model_variables[unknowns[k]].type == MODEL_REAL;
        if (good) {
            memcpy(&moved[k], ends + model_size + model_variables[unknowns[k]].offset, sizeof(double));
        }
    }
    free(ends);
    return good || failed(instance, "there is no such directional derivative");
}
