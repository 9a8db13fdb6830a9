/* The states of an instance, in memory and as bytes. */
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "instance.h"

/* In memory: the model follows. */
struct snapshot {
    struct snapshot *next;
    struct progress at;
};

/* As bytes: this, where the instance was, the model, and a checksum of all of them. */
struct head {
    char token[40];  /* of the model */
    uint64_t format; /* of these bytes, whose order it shows */
    uint64_t size;   /* of all bytes */
};

#define FORMAT 0x0102030405060001u

static size_t serialized_size(void)
{
    return sizeof(struct head) + sizeof(struct progress) + model_size + sizeof(uint64_t);
}

static bool is_own(struct instance *instance, const void *state)
{
    const struct snapshot *each = instance->snapshots;
    while (each != NULL && each != state) {
        each = each->next;
    }
    if (each == NULL) {
        instance_refuse(instance, "expected a state that this instance took or read and that is not freed");
    }
    return each != NULL;
}

static bool is_there(struct instance *instance, const void *pointer)
{
    if (pointer == NULL) {
        instance_refuse(instance, "expected an address, got a null pointer");
    }
    return pointer != NULL;
}

/* The snapshot that a state is, or a new one for a null pointer; a null pointer, and an error, where there is none. */
static struct snapshot *snapshot_of(struct instance *instance, void **state)
{
    struct snapshot *made;
    if (*state != NULL) {
        return is_own(instance, *state) ? *state : NULL;
    }
    made = calloc(1, sizeof *made + model_size);
    if (made == NULL) {
        instance_refuse(instance, "there is no memory");
        return NULL;
    }
    made->next = instance->snapshots;
    instance->snapshots = made;
    *state = made;
    return made;
}

static enum outcome keep(struct instance *instance, const struct progress *at, const struct model *model, void **state)
{
    struct snapshot *snapshot = snapshot_of(instance, state);
    if (snapshot == NULL) {
        return OUTCOME_ERROR;
    }
    memcpy(&snapshot->at, at, sizeof *at);
    model_copy((struct model *)(snapshot + 1), model);
    return OUTCOME_OK;
}

enum outcome instance_get_state(struct instance *instance, void **state)
{
    if (!is_there(instance, state)) {
        return OUTCOME_ERROR;
    }
    instance_refresh(instance); /* so that equal states are equal bytes */
    return keep(instance, &instance->at, instance->model, state);
}

enum outcome instance_set_state(struct instance *instance, const void *state)
{
    const struct snapshot *snapshot = state;
    if (!is_own(instance, state)) {
        return OUTCOME_ERROR;
    }
    if (snapshot->at.mode == MODE_EVENT && !instance->wishes.has_event_mode) {
        return instance_refuse(instance, "the state is in event mode, which this instance has not");
    }
    memcpy(&instance->at, &snapshot->at, sizeof instance->at);
    model_copy(instance->model, (const struct model *)(snapshot + 1));
    instance->stale = true;
    return OUTCOME_OK;
}

enum outcome instance_free_state(struct instance *instance, void **state)
{
    struct snapshot **link = &instance->snapshots, *found;
    if (state == NULL || *state == NULL) {
        return OUTCOME_OK;
    }
    if (!is_own(instance, *state)) {
        return OUTCOME_ERROR;
    }
    while (*link != *state) {
        link = &(*link)->next;
    }
    found = *link;
    *link = found->next;
    free(found);
    *state = NULL;
    return OUTCOME_OK;
}

void instance_free_states(struct instance *instance)
{
    while (instance->snapshots != NULL) {
        struct snapshot *first = instance->snapshots;
        instance->snapshots = first->next;
        free(first);
    }
}

/* ---- as bytes ---- */

/* FNV-1a with 64 bits: each byte changes it one to one, so that no change of a single byte is missed. */
static uint64_t checksum_of(const unsigned char *bytes, size_t size)
{
    uint64_t sum = 14695981039346656037u;
    size_t k;
    for (k = 0; k < size; ++k) {
        sum = (sum ^ bytes[k]) * 1099511628211u;
    }
    return sum;
}

static struct head head_of(void)
{
    struct head head = {{0}, FORMAT, 0};
    strncpy(head.token, model_token, sizeof head.token - 1);
    head.size = serialized_size();
    return head;
}

enum outcome instance_serialized_size(struct instance *instance, const void *state, size_t *size)
{
    if (!is_there(instance, size) || !is_own(instance, state)) {
        return OUTCOME_ERROR;
    }
    *size = serialized_size();
    return OUTCOME_OK;
}

enum outcome instance_serialize(struct instance *instance, const void *state, void *bytes, size_t size)
{
    const struct snapshot *snapshot = state;
    const struct head head = head_of();
    char *to = bytes;
    uint64_t sum;
    if (!is_there(instance, bytes) || !is_own(instance, state)) {
        return OUTCOME_ERROR;
    }
    if (size < serialized_size()) {
        return instance_refuse(instance, "expected room for %lu bytes, got %lu", (unsigned long)serialized_size(),
                               (unsigned long)size);
    }
    memcpy(to, &head, sizeof head);
    memcpy(to + sizeof head, &snapshot->at, sizeof snapshot->at);
    memcpy(to + sizeof head + sizeof snapshot->at, snapshot + 1, model_size);
    sum = checksum_of(bytes, serialized_size() - sizeof sum);
    memcpy(to + serialized_size() - sizeof sum, &sum, sizeof sum);
    return OUTCOME_OK;
}

static bool is_mode(int32_t mode)
{
    return mode == MODE_INSTANTIATED || mode == MODE_INITIALIZING || mode == MODE_EVENT || mode == MODE_STEPPING ||
           mode == MODE_TERMINATED || mode == MODE_FAILED;
}

static bool is_truth(int32_t value)
{
    return value == 0 || value == 1;
}

static bool is_sound_progress(const struct progress *at)
{
    return is_mode(at->mode) && is_truth(at->event) && is_truth(at->experiment.stops) && is_truth(at->experiment.is_set) &&
           at->steps >= 0 && isfinite(at->experiment.start) && isfinite(at->experiment.stop) && isfinite(at->elapsed) &&
           isfinite(at->remainder) && isfinite(at->time);
}

static bool is_sound_value(const struct model_variable *variable, const char *place)
{
    const bool is_set = variable->setting != MODEL_NEVER;
    double real;
    int32_t integer;
    switch (variable->type) {
    case MODEL_REAL:
        memcpy(&real, place, sizeof real);
        return isfinite(real) && (!is_set || (real >= variable->low && real <= variable->high));
    case MODEL_INTEGER:
        memcpy(&integer, place, sizeof integer);
        return !is_set || (integer >= variable->low && integer <= variable->high);
    case MODEL_BOOLEAN:
        return *place == 0 || *place == 1;
    case MODEL_TEXTUAL:
        return memchr(place, '\0', MODEL_TEXT) != NULL;
    }
    return false;
}

static bool is_sound(const struct progress *at, const struct model *model)
{
    size_t k;
    for (k = 0; k < model_count; ++k) {
        if (!is_sound_value(&model_variables[k], (const char *)model + model_variables[k].offset)) {
            return false;
        }
    }
    return is_sound_progress(at) && model_is_sound(model);
}

enum outcome instance_deserialize(struct instance *instance, const void *bytes, size_t size, void **state)
{
    const struct head head = head_of();
    const char *from = bytes;
    struct progress at;
    uint64_t sum;
    if (!is_there(instance, bytes) || !is_there(instance, state)) {
        return OUTCOME_ERROR;
    }
    if (size != serialized_size()) {
        return instance_refuse(instance, "expected a state of %lu bytes, got %lu", (unsigned long)serialized_size(),
                               (unsigned long)size);
    }
    if (memcmp(from, &head, sizeof head) != 0) {
        return instance_refuse(instance, "expected a state of the model %s, got one of another model or format", model_token);
    }
    memcpy(&sum, from + size - sizeof sum, sizeof sum);
    if (sum != checksum_of(bytes, size - sizeof sum)) {
        return instance_refuse(instance, "the state is damaged: its checksum is another one");
    }
    memcpy(&at, from + sizeof head, sizeof at);
    memcpy(instance->spare, from + sizeof head + sizeof at, model_size);
    if (!is_sound(&at, instance->spare)) {
        return instance_refuse(instance, "the state is damaged: it holds values that no instance has");
    }
    return keep(instance, &at, instance->spare, state);
}
