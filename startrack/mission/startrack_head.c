/* Error model of one star tracker; see startrack_head.h. */
#include "startrack_head.h"
#include "startrack_head_data.h"

#include <math.h>

static uint64_t bits(startrack_head *head)
{
    /* SplitMix64: Steele, Lea and Flood (2014), OOPSLA. */
    uint64_t z = (head->random += 0x9E3779B97F4A7C15u);
    z = (z ^ (z >> 30)) * 0xBF58476D1CE4E5B9u;
    z = (z ^ (z >> 27)) * 0x94D049BB133111EBu;
    return z ^ (z >> 31);
}

static double uniform(startrack_head *head)
{
    return ((double)(bits(head) >> 11) + 0.5) / 9007199254740992.0;
}

static double normal(startrack_head *head)
{
    /* Box and Muller (1958). */
    double radius = sqrt(-2.0 * log(uniform(head)));
    return radius * cos(6.283185307179586 * uniform(head));
}

/* A column of the table at a rate, by straight lines; its ends hold beyond them. */
static double at_rate(const double *column, double rate)
{
    int k = 0;
    double part;
    if (!(rate > startrack_rate[0]))
        return column[0];
    while (k < STARTRACK_RATES - 2 && rate > startrack_rate[k + 1])
        k++;
    part = (rate - startrack_rate[k]) / (startrack_rate[k + 1] - startrack_rate[k]);
    if (part > 1.0)
        part = 1.0;
    return column[k] + part * (column[k + 1] - column[k]);
}

void startrack_start(startrack_head *head, uint64_t seed)
{
    int axis;
    head->random = seed;
    head->phase = 6.283185307179586 * uniform(head);
    for (axis = 0; axis < 3; axis++) {
        head->bias[axis] = normal(head);
        head->field[axis] = normal(head);
        head->pixel[axis] = normal(head);
    }
}

int startrack_frame(startrack_head *head, double interval, double rate, double sun, double moon,
                    double limb, double orbit, double error[3])
{
    double keep_field = exp(-interval * rate / STARTRACK_FIELD);
    double keep_pixel = exp(-interval * rate / STARTRACK_PIXEL);
    double swing = 1.4142135623730951 * sin(orbit + head->phase);
    int axis, seen;
    for (axis = 0; axis < 3; axis++) {
        int k = axis == 2; /* about the boresight, not across */
        double *field = &head->field[axis], *pixel = &head->pixel[axis];
        *field = keep_field * *field + sqrt(1.0 - keep_field * keep_field) * normal(head);
        *pixel = keep_pixel * *pixel + sqrt(1.0 - keep_pixel * keep_pixel) * normal(head);
        error[axis] = startrack_bias[k] * head->bias[axis] + startrack_swing[k] * swing
                      + at_rate(startrack_field[k], rate) * *field
                      + at_rate(startrack_pixel[k], rate) * *pixel
                      + at_rate(startrack_noise[k], rate) * normal(head);
    }
    seen = uniform(head) < at_rate(startrack_available, rate);
    return seen && sun > STARTRACK_SUN && moon > STARTRACK_MOON && limb > STARTRACK_LIMB
           && !(rate > startrack_rate[STARTRACK_RATES - 1]);
}

void startrack_measure(const double truth[4], const double error[3], double measured[4])
{
    double angle = sqrt(error[0] * error[0] + error[1] * error[1] + error[2] * error[2]);
    double half = angle > 1e-9 ? sin(0.5 * angle) / angle : 0.5;
    double x = half * error[0], y = half * error[1], z = half * error[2], w = cos(0.5 * angle);
    measured[0] = w * truth[0] + x * truth[3] + y * truth[2] - z * truth[1];
    measured[1] = w * truth[1] - x * truth[2] + y * truth[3] + z * truth[0];
    measured[2] = w * truth[2] + x * truth[1] - y * truth[0] + z * truth[3];
    measured[3] = w * truth[3] - x * truth[0] - y * truth[1] - z * truth[2];
}
