/* Error model of one star tracker, for simulators of attitude control. C99 and its libm alone.

   Made by startrack; the numbers of a design are in startrack_head_data.h. All units are SI: radian,
   second. Camera axes: z is the boresight, x to larger columns, y to larger rows of the detector.

       error = bias + swing sin(orbit) + field + pixel + noise      about the camera's axes

   bias    one draw for each head (mounting, time stamp, aberration that is not corrected)
   swing   thermo-elastic, one sinusoid an orbit with a random phase
   field   changes while stars cross the field:  Gauss-Markov, time = STARTRACK_FIELD / rate
   pixel   changes while stars cross pixels:     Gauss-Markov, time = STARTRACK_PIXEL / rate
   noise   white from frame to frame */
#ifndef STARTRACK_HEAD_H
#define STARTRACK_HEAD_H

#include <stdint.h>

typedef struct {
    uint64_t random;                            /* state of the generator */
    double bias[3], phase, field[3], pixel[3];  /* of unit variance; radian */
} startrack_head;

/* Draws what is constant; the same seed gives the same errors. */
void startrack_start(startrack_head *head, uint64_t seed);

/* The next frame; call it once a frame, STARTRACK_PERIOD apart, or less often.

   interval      second since the frame before
   rate          rad / s across the boresight
   sun, moon     radian from the boresight to their centres; 4 where the Earth hides them
   limb          radian from the boresight to the lit limb of the Earth; 4 where there is none
   orbit         radian, phase of the orbit
   error         rotation vector from the true to the measured attitude, camera axes
   Returns 1 where there is an attitude, 0 where the head is blind or detects too few stars; the
   error is that of the next attitude then. */
int startrack_frame(startrack_head *head, double interval, double rate, double sun, double moon,
                    double limb, double orbit, double error[3]);

/* The measured quaternion: (x, y, z, w), scalar last, of the rotation of directions from ICRS axes
   into camera axes; measured = exp(error) true. It is that of STARTRACK_LATENCY before its output. */
void startrack_measure(const double truth[4], const double error[3], double measured[4]);

#endif
