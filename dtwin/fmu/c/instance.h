/* A model in the hands of a simulator: what FMI 2.0 and FMI 3.0 have in common.
 *
 * What is refused changes nothing: each function checks all that it is given before it changes the instance, and takes
 * a step back that the model could not end. */
#ifndef DTWIN_INSTANCE_H
#define DTWIN_INSTANCE_H

#include "calls.h"
#include "model.h"

/* The numbers of fmi2Status and fmi3Status. */
enum outcome { OUTCOME_OK = 0, OUTCOME_DISCARD = 2, OUTCOME_ERROR = 3 };

/* The categories of messages, which modelDescription.xml names. */
enum { LOG_DISCARD, LOG_ERROR, LOG_CATEGORIES };
extern const char *const log_categories[LOG_CATEGORIES];

/* The times of an experiment. */
struct experiment {
    double start, stop;
    int32_t stops; /* whether the stop counts */
    int32_t is_set;
};

/* Where an instance is: with the model all that a snapshot keeps. */
struct progress {
    int32_t mode;
    int32_t event; /* whether a discrete output changed in the last step */
    struct experiment experiment;
    int64_t steps;
    double elapsed, remainder; /* the sum of the steps, and what its rounding left */
    double time;               /* the end of the last step, as the simulator adds it up */
};

struct instance;
typedef void (*instance_log)(struct instance *instance, enum outcome outcome, const char *category, const char *text);

/* What a simulator says when it makes an instance. */
struct wishes {
    int version; /* of FMI: 2 or 3 */
    const char *name, *token;
    bool has_event_mode;
    bool logging;
    void *environment;
    instance_log log;
    void (*logger)(void); /* of the simulator, for `log` */
};

struct snapshot;

struct instance {
    struct wishes wishes;
    struct model *model, *spare; /* the spare one is what a step began with */
    struct progress at;
    bool stale;             /* whether the outputs have to be computed */
    const char *function;   /* that was called */
    bool logged[LOG_CATEGORIES];
    struct snapshot *snapshots; /* that were taken and not freed */
    char *name;
};

/* A new instance, or a null pointer; then what was wrong is logged, also where logging is off. */
struct instance *instance_new(const struct wishes *wishes, const char *function);
void instance_free(struct instance *instance);

/* The instance of a call that is allowed now; a null pointer, and an error, if it is not. */
struct instance *instance_called(void *handle, enum call call, const char *function);

/* Log what was wrong and return OUTCOME_ERROR or OUTCOME_DISCARD. */
enum outcome instance_refuse(struct instance *instance, const char *format, ...);
enum outcome instance_discard(struct instance *instance, const char *format, ...);

enum outcome instance_set_logging(struct instance *instance, bool on, size_t count, const char *const categories[]);
void instance_reset(struct instance *instance);

/* Whether an array can be there: it has no values, or it is none of the null pointers. */
bool instance_has_arrays(struct instance *instance, size_t count, const void *references, const void *values);

/* Computes outputs where something changed since. */
void instance_refresh(struct instance *instance);

/* Getting: all are checked, then each is got. Setting: likewise. */
enum outcome instance_check_get(struct instance *instance, const uint32_t *references, size_t count,
                                enum model_type type);
void instance_get(struct instance *instance, uint32_t reference, void *value);
enum outcome instance_check_set(struct instance *instance, uint32_t reference, enum model_type type,
                                const void *value);
void instance_set(struct instance *instance, uint32_t reference, const void *value);

enum outcome instance_set_up(struct instance *instance, const double *tolerance, double start, const double *stop);
enum outcome instance_begin(struct instance *instance);
enum outcome instance_step(struct instance *instance, double time, double duration);

/* Snapshots, which belong to the instance that took them. A state is null or one of these. */
enum outcome instance_get_state(struct instance *instance, void **state);
enum outcome instance_set_state(struct instance *instance, const void *state);
enum outcome instance_free_state(struct instance *instance, void **state);
void instance_free_states(struct instance *instance);

/* Snapshots as bytes, which any process with the same model may read. */
enum outcome instance_serialized_size(struct instance *instance, const void *state, size_t *size);
enum outcome instance_serialize(struct instance *instance, const void *state, void *bytes, size_t size);
enum outcome instance_deserialize(struct instance *instance, const void *bytes, size_t size, void **state);

/* moved = (d unknowns / d knowns) seed. */
enum outcome instance_derivative(struct instance *instance, const uint32_t *unknowns, size_t unknown_count,
                                 const uint32_t *knowns, size_t known_count, const double *seed, double *moved);

#endif
