/* What passes between a serial arm and its controller. */
#ifndef DTWIN_EXCHANGE_H
#define DTWIN_EXCHANGE_H

#include <string.h>

#include "arm.h"
#include "control.h"

static inline void take_sample(struct control *control, const struct arm *arm)
{
    memcpy(control->q, arm->q, sizeof control->q);
}

static inline void give_command(struct arm *arm, const struct control *control)
{
    memcpy(arm->u, control->u, sizeof arm->u);
}

static inline bool box_waits(const struct control *control)
{
    return control->box > 0;
}

#endif
