/* A controller in C around exported functions: it moves a simulated arm, which is then pushed. */
#include <math.h>
#include <stdio.h>
#include <string.h>
#include "arm.h"

#define STEP 0.001       /* s */
#define MOTION 1.0       /* s, the duration of the motion */
#define DURATION 3.0     /* s */
#define PUSH 2.0         /* N m at the first joint, from PUSHED on */
#define PUSHED 2.0       /* s */
#define OBSERVER 50.0    /* 1/s */
#define THRESHOLD 1.0    /* N m, an external torque that counts as a collision */
#define RATE 5000.0      /* N m/s, the largest rate of the torques */
#define GOAL 0.8         /* rad */

/* The desired motion: a quintic from 0 to GOAL. */
static void desired(double t, double *q, double *u, double *udot)
{
    const double x = t < MOTION ? t / MOTION : 1.0;
    int j;
    for (j = 0; j < ARM_N; ++j) {
        q[j] = GOAL * x * x * x * (10.0 - 15.0 * x + 6.0 * x * x);
        u[j] = GOAL / MOTION * 30.0 * x * x * (1.0 - x) * (1.0 - x);
        udot[j] = GOAL / (MOTION * MOTION) * 60.0 * x * (1.0 - x) * (1.0 - 2.0 * x);
    }
}

int main(void)
{
    double q[ARM_N] = {0}, u[ARM_N] = {0}, tau[ARM_N] = {0}, applied[ARM_N], udot[ARM_N];
    double q_d[ARM_N], u_d[ARM_N], udot_d[ARM_N], gains[2 * ARM_N];
    double memory[ARM_MOMENTUM_OBSERVER_SIZE] = {0}, forgotten[ARM_N], change[ARM_N], elapsed = 0.0;
    double threshold[ARM_N], collision[ARM_COLLISION_DETECTOR_SIZE] = {0};
    const double settings[3] = {0.005, 0.8, 0.2}; /* confirm, s; release; clear, s */
    double collision_time = -1.0;
    int j, k;

    if (arm_self_test() != 0) {
        fprintf(stderr, "arm.c: the self-test fails; expected the numbers at its export\n");
        return 1;
    }
    for (j = 0; j < ARM_N; ++j) {
        gains[j] = 400.0;         /* kp, 1/s^2 */
        gains[ARM_N + j] = 40.0;  /* kd, 1/s */
        forgotten[j] = exp(-OBSERVER * STEP);
        change[j] = RATE * STEP;
        threshold[j] = THRESHOLD;
    }
    for (k = 0; k * STEP < DURATION; ++k) {
        const int wrong = arm_check_state(q, u);
        if (wrong != 0) {
            fprintf(stderr, "state: entry %d is out of range; expected finite numbers\n", wrong);
            return 2;
        }
        /* The torque of the last step has acted until now. */
        arm_momentum_observer(q, u, tau, memory, &elapsed, forgotten, NULL, memory);
        arm_collision_detector(memory, threshold, settings, collision, &elapsed, NULL, collision);
        if (collision[0] > 0.5 && collision_time < 0.0) collision_time = k * STEP;
        elapsed = STEP;
        desired(k * STEP, q_d, u_d, udot_d);
        memcpy(applied, tau, sizeof tau);
        arm_computed_torque(q, u, q_d, u_d, udot_d, gains, NULL, tau);
        arm_limited_torque(tau, applied, arm_effort_limits, change, NULL, tau);

        /* The arm itself, here a simulation; semi-implicit steps. */
        memcpy(applied, tau, sizeof tau);
        if (k * STEP >= PUSHED) applied[0] += PUSH;
        arm_forward_dynamics(q, u, applied, NULL, udot);
        for (j = 0; j < ARM_N; ++j) {
            u[j] += STEP * udot[j];
            q[j] += STEP * u[j];
        }
    }
    for (j = 0; j < ARM_N; ++j)
        printf("%s %.9f %.9f %.9f\n", arm_joint_names[j], q[j], memory[j], arm_effort_limits[j]);
    printf("collision at %.3f s\n", collision_time);
    q[0] = 1e15;
    printf("refused %d", arm_check_state(q, u));
    q[0] = 0.0;
    u[ARM_N - 1] = NAN;
    printf(" %d\n", arm_check_state(q, u));
    return 0;
}
