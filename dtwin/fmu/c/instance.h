/* A model in the hands of a simulator: what FMI 2.0 and FMI 3.0 have in common. */
#ifndef DTWIN_INSTANCE_H
#define DTWIN_INSTANCE_H

#include "model.h"

enum mode { MODE_INSTANTIATED, MODE_INITIALIZING, MODE_STEPPING, MODE_EVENT, MODE_TERMINATED };

struct instance {
    struct model *model;
    enum mode mode;
    bool stale;        /* whether the outputs have to be computed */
    bool event;        /* whether a discrete output changed in the last step */
    double start_time; /* of the simulation */
    bool has_event_mode;
    void *environment; /* of the simulator, as is what follows */
    void (*tell)(struct instance *instance, const char *message);
    void (*logger)(void);
    char *name;
};

/* A new instance, or a null pointer where the token is another model's or memory is short. */
struct instance *instance_new(const char *token, const char *name);
void instance_free(struct instance *instance);

/* Both return whether it could be done; the instance tells what was wrong. */
bool instance_get(struct instance *instance, uint32_t reference, enum model_type type, void *value);
bool instance_set(struct instance *instance, uint32_t reference, enum model_type type, const void *value);

void instance_reset(struct instance *instance);
bool instance_begin(struct instance *instance);
bool instance_step(struct instance *instance, double time, double duration);

/* Snapshots of instance_size() bytes, which any process with the same model may load. Where *state is a null pointer
 * memory is made for one, to be ended by free(). */
size_t instance_size(void);
bool instance_snapshot(const struct instance *instance, void **state);
bool instance_load(struct instance *instance, const void *bytes, size_t size);

/* Checks the bytes of a snapshot and copies them. */
bool instance_unpack(struct instance *instance, const void *bytes, size_t size, void **state);

/* moved = (d unknowns / d knowns) seed. */
bool instance_derivative(struct instance *instance, const uint32_t *unknowns, size_t unknown_count,
                         const uint32_t *knowns, size_t known_count, const double *seed, double *moved);

#endif
