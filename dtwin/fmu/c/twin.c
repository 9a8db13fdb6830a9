#include "twin.h"

#include <string.h>

#include "model.h"

void model_reset(struct model *model)
{
    memset(model, 0, sizeof *model);
    model_set_start_values(model);
}

const char *model_begin(struct model *model, double time)
{
    model->time = time;
    model->begun = true;
    arm_begin(&model->arm);
    return NULL;
}

const char *model_step(struct model *model, double time, double duration)
{
    model->time = time + duration;
    return arm_advance(&model->arm, duration) ? NULL : "the state of the arm is no longer finite";
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
    struct arm along = direction->arm;
    int i;
    for (i = 0; i < 6; ++i) {
        along.x[i] += model->begun ? 0.0 : direction->arm.start[i];
        moved->arm.x[i] = along.x[i];
    }
    moved->arm.gripper = direction->arm.gripper + (model->begun ? 0.0 : direction->arm.gripper_start);
    moved->arm.gripper_omega = direction->arm.gripper_omega;
    arm_derivative(&model->arm, &along, moved->arm.alpha);
    return true;
}
