#include "twin.h"

#include <string.h>

#include "model.h"

void model_copy(struct model *to, const struct model *from)
{
    *to = *from;
}

void model_reset(struct model *model)
{
    memset(model, 0, sizeof *model);
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
    return NULL;
}

const char *model_step(struct model *model, double time, double duration, double rounding)
{
    model->time = time;
    return arm_advance(&model->arm, duration, rounding);
}

void model_refresh(struct model *model)
{
    arm_refresh(&model->arm);
}

bool model_derivative(const struct model *model, const struct model *direction, struct model *moved)
{
    return arm_derivative(&model->arm, &direction->arm, &moved->arm);
}

bool model_is_sound(const struct model *model)
{
    return arm_is_sound(&model->arm);
}
