/* What the controller of a serial arm has: its blocks, a sample, the command that answers it, and its clock. */
#ifndef DTWIN_CONTROL_STATE_H
#define DTWIN_CONTROL_STATE_H

#include "constants.h"
#include "model.h"
#include "program.h"

struct control {
    struct program program;
    /* inputs: a sample */
    double q[JOINTS];
    int32_t box; /* the place of the box that waits, from 1; 0 for none */
    /* outputs: the command that answers it */
    double u[JOINTS];
    bool box_gripped;
    /* the clock */
    double wait; /* until the next tick is due */
};

#endif
