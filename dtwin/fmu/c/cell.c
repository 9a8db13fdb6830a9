#include "cell.h"

#include <string.h>

#include "constants.h"
#include "exchange.h"

void model_copy(struct model *to, const struct model *from)
{
    to->time = from->time;
    to->box_mass = from->box_mass;
    to->arm = from->arm;
    control_copy(&to->control, &from->control);
}

void model_reset(struct model *model)
{
    memset(model, 0, sizeof *model);
    control_reset(&model->control);
    model_set_start_values(model);
}

const char *model_check(const struct model *model)
{
    return arm_check(&model->arm);
}

const char *model_begin(struct model *model, double time)
{
    model->time = time;
    arm_begin(&model->arm);
    return control_begin(&model->control);
}

/* A sample, its answer, and what the gripper does with the box. */
static const char *tick(struct model *model)
{
    struct control *control = &model->control;
    struct arm *arm = &model->arm;
    const bool held = control->box_gripped;
    const char *problem;
    take_sample(control, arm);
    problem = control_tick(control);
    give_command(arm, control);
    if (control->box_gripped != held) {
        arm->payload = control->box_gripped && box_waits(control) ? model->box_mass : 0.0;
    }
    return problem;
}

const char *model_step(struct model *model, double time, double duration, double rounding)
{
    const double before = control_wait(&model->control, rounding);
    int64_t ticks = control_pass(&model->control, duration, rounding);
    const double after = control_wait(&model->control, rounding);
    double span = ticks == 0 ? before - after : before; /* until the next tick or the end */
    const char *problem = span > 0.0 ? arm_advance(&model->arm, span, rounding) : NULL;
    for (; problem == NULL && ticks > 0; --ticks) {
        span = ticks == 1 ? PERIOD - after : PERIOD;
        problem = tick(model);
        if (problem == NULL) {
            problem = arm_advance(&model->arm, span, rounding);
        }
    }
    model->time = time;
    return problem;
}

void model_refresh(struct model *model)
{
    arm_refresh(&model->arm);
}

bool model_derivative(const struct model *model, const struct model *direction, struct model *moved)
{
    (void)model;
    (void)direction;
    (void)moved;
    return false;
}

bool model_is_sound(const struct model *model)
{
    return arm_is_sound(&model->arm) && control_is_sound(&model->control);
}
