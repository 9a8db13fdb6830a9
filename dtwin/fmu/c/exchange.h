/* What passes between the arm of the cell and its controller. */
#ifndef DTWIN_EXCHANGE_H
#define DTWIN_EXCHANGE_H

#include <string.h>

#include "arm.h"
#include "control.h"

static inline void take_sample(struct control *control, const struct arm *arm)
{
    memcpy(control->theta, arm->x, sizeof control->theta);
    control->gripper = arm->gripper;
}

static inline void give_command(struct arm *arm, const struct control *control)
{
    memcpy(arm->volts, control->volts, sizeof arm->volts);
}

static inline bool box_waits(const struct control *control)
{
    return control->box_present;
}

#endif
