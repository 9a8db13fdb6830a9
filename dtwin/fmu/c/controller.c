#include "controller.h"

#include "constants.h"

void model_copy(struct model *to, const struct model *from)
{
    to->time = from->time;
    control_copy(&to->control, &from->control);
}

void model_reset(struct model *model)
{
    control_reset(&model->control);
    model->time = 0.0;
    model_set_start_values(model);
}

const char *model_check(const struct model *model)
{
    (void)model;
    return NULL;
}

const char *model_begin(struct model *model, double time)
{
    model->time = time;
    return control_begin(&model->control);
}

/* Ticks that are due at the beginning of the step or within it answer the sample that is held. */
const char *model_step(struct model *model, double time, double duration, double rounding)
{
    const char *problem = NULL;
    int64_t ticks = control_pass(&model->control, duration, rounding);
    model->time = time;
    for (; problem == NULL && ticks > 0; --ticks) {
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

bool model_is_sound(const struct model *model)
{
    return control_is_sound(&model->control);
}
