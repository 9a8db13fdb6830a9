/* What a model gives to the functions that a simulator calls. A model is one structure without pointers, so that its
 * bytes are a snapshot of it. */
#ifndef DTWIN_MODEL_H
#define DTWIN_MODEL_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#define MODEL_TEXT 255

enum model_type { MODEL_REAL, MODEL_INTEGER, MODEL_BOOLEAN, MODEL_TEXTUAL };
enum model_setting { MODEL_NEVER, MODEL_BEFORE_START, MODEL_ALWAYS };

/* A variable of the model, whose value reference is its row: double, int32_t, bool or char[MODEL_TEXT]. */
struct model_variable {
    const char *name;
    size_t offset;
    enum model_type type;
    enum model_setting setting; /* when it can be set */
    double low, high;           /* least and greatest number that can be set */
};

struct model;

/* In variables.c, which is generated with modelDescription.xml. */
extern const struct model_variable model_variables[];
extern const size_t model_count;
extern const size_t model_size;
extern const char model_token[];
void model_set_start_values(struct model *model);
/* The outputs whose changes are events, as the bits of a number. */
uint64_t model_events(const struct model *model);

/* Copies all that counts between two calls; the rest of the copy is left as it is. */
void model_copy(struct model *to, const struct model *from);

/* Puts everything to its beginning. */
void model_reset(struct model *model);

/* Whether parameters fit together; returns what is wrong, or a null pointer. */
const char *model_check(const struct model *model);

/* Ends the initialisation at a time; returns what is wrong, or a null pointer. */
const char *model_begin(struct model *model, double time);

/* Lets a duration pass until a time, whose numbers differ by a rounding, and computes outputs; returns what is wrong, or
 * a null pointer. Where something is wrong the model is of no more use. */
const char *model_step(struct model *model, double time, double duration, double rounding);

/* Computes outputs from states and inputs. */
void model_refresh(struct model *model);

/* How variables move when others move: the two arguments are models of which only what moves counts. Returns whether
 * the model knows. */
bool model_derivative(const struct model *model, const struct model *direction, struct model *moved);

/* Whether the parts of a model that are no variables can be used; for bytes that come from somewhere. */
bool model_is_sound(const struct model *model);

#endif
