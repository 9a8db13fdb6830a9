#include "controller.h"

#include "constants.h"

void model_reset(struct model *model)
{
    control_reset(&model->control);
    model->time = 0.0;
    model_set_start_values(model);
}

const char *model_begin(struct model *model, double time)
{
    model->time = time;
    return control_begin(&model->control, time);
}

/* Ticks that are due at the beginning of the step or within it answer the sample that is held. */
const char *model_step(struct model *model, double time, double duration)
{
    const char *problem = NULL;
    model->time = time + duration;
    while (problem == NULL && control_due(&model->control) < model->time - CLOCK_ROUNDING) {
        problem = control_tick(&model->control);
    }
    return problem;
}

void model_refresh(struct model *model)
{
    (void)model;
}

bool model_derivative(const struct model *model, const struct model *direction, struct model *moved)
{
    (void)model;
    (void)direction;
    (void)moved;
    return false;
}
