/* What a model gives to the functions that a simulator calls. A model is one structure without pointers: a copy of its
 * bytes is a snapshot of it. */
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
    size_t offset;
    enum model_type type;
    enum model_setting setting; /* when it can be set */
    bool event;                 /* whether it is an output whose change is an event */
};

struct model;

/* In variables.c, which is generated with modelDescription.xml. */
extern const struct model_variable model_variables[];
extern const size_t model_count;
extern const size_t model_size;
extern const char model_token[];
void model_set_start_values(struct model *model);

/* Puts everything to its beginning. */
void model_reset(struct model *model);

/* Ends the initialisation at a time; returns what is wrong, or a null pointer. */
const char *model_begin(struct model *model, double time);

/* Lets time pass; returns what is wrong, or a null pointer. */
const char *model_step(struct model *model, double time, double duration);

/* Computes outputs from states and inputs. */
void model_refresh(struct model *model);

/* How variables move when others move: the two arguments are models of which only what moves counts. Returns whether
 * the model knows. */
bool model_derivative(const struct model *model, const struct model *direction, struct model *moved);

#endif
