/* The control application of dtwin, its function blocks as machine code, with its clock. */
#ifndef DTWIN_CONTROL_H
#define DTWIN_CONTROL_H

#include "model.h"
#include "program.h"

struct control {
    struct program program;
    /* inputs: a sample */
    double theta[3];
    double gripper;
    bool box_present;
    char box_colour[MODEL_TEXT];
    /* outputs: the command that answers it */
    double volts[4];
    bool box_gripped;
    /* the clock */
    double first; /* time of tick 0 */
    int64_t ticks;
};

/* Puts the blocks to their beginning. */
void control_reset(struct control *control);

/* Starts the blocks; the first tick is due at a time. Returns what is wrong, or a null pointer. */
const char *control_begin(struct control *control, double time);

/* When the next tick is due. */
double control_due(const struct control *control);

/* Lets the blocks answer the sample. Returns what is wrong, or a null pointer. */
const char *control_tick(struct control *control);

#endif
