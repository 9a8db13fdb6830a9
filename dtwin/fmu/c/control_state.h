/* What the controller of the cell has: its blocks, a sample, the command that answers it, and its clock. */
#ifndef DTWIN_CONTROL_STATE_H
#define DTWIN_CONTROL_STATE_H

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
    double wait; /* until the next tick is due */
};

#endif
