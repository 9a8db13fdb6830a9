#include "cell.h"

#include <math.h>
#include <string.h>

#include "constants.h"

void model_reset(struct model *model)
{
    memset(model, 0, sizeof *model);
    control_reset(&model->control);
    model_set_start_values(model);
}

const char *model_begin(struct model *model, double time)
{
    model->time = time;
    model->begun = true;
    arm_begin(&model->arm);
    return control_begin(&model->control, time);
}

/* A sample, its answer, and what the gripper does with the box. */
static const char *tick(struct model *model)
{
    struct control *control = &model->control;
    struct arm *arm = &model->arm;
    const bool held = control->box_gripped;
    const char *problem;
    memcpy(control->theta, arm->x, sizeof control->theta);
    control->gripper = arm->gripper;
    problem = control_tick(control);
    memcpy(arm->volts, control->volts, sizeof arm->volts);
    if (control->box_gripped != held) {
        arm->payload = control->box_gripped && control->box_present ? model->box_mass : 0.0;
    }
    return problem;
}

const char *model_step(struct model *model, double time, double duration)
{
    const double end = time + duration;
    double now = time;
    while (now < end - CLOCK_ROUNDING) {
        double until = control_due(&model->control), span;
        if (until < now + CLOCK_ROUNDING) {
            const char *problem = tick(model);
            if (problem != NULL) {
                return problem;
            }
            until = control_due(&model->control);
        }
        if (until > end - CLOCK_ROUNDING) {
            until = end;
        }
        span = until - now;
        if (!arm_advance(&model->arm, fabs(span - PERIOD) < CLOCK_ROUNDING ? PERIOD : span)) {
            return "the state of the arm is no longer finite";
        }
        now = until;
    }
    model->time = end;
    return NULL;
}

void model_refresh(struct model *model)
{
    if (!model->begun) {
        arm_begin(&model->arm);
    }
    arm_refresh(&model->arm);
}

bool model_derivative(const struct model *model, const struct model *direction, struct model *moved)
{
    (void)model;
    (void)direction;
    (void)moved;
    return false;
}
