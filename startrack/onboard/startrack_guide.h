/* Guide stars and patterns of a star tracker: reader of startrack_guide.bin, and identification.
 *
 * C99; needs sqrt, asin and log of the C library alone, and allocates nothing. The bytes of the
 * file stay where the caller has them (a file, flash memory, startrack_guide_data.h) and are read
 * one by one, so that neither alignment nor the byte order of the machine matters.
 *
 * Directions are unit vectors. Stars: ICRS axes at the epoch of the catalogue, as seen from the
 * barycentre (aberration and parallax are the caller's). Stars are numbered from 0 in rising order
 * of their z. Angles are in radian. Layout of the bytes: docs/onboard.md of startrack.
 */
#ifndef STARTRACK_GUIDE_H
#define STARTRACK_GUIDE_H

#include <stddef.h>
#include <stdint.h>

/* What startrack_guide_open returns. */
enum {
    STARTRACK_GUIDE_GOOD = 0,
    STARTRACK_GUIDE_FORMAT = 1,  /* not such a file, or of a later version */
    STARTRACK_GUIDE_CUT = 2,     /* shorter than its header says */
    STARTRACK_GUIDE_CHECKSUM = 3, /* damaged */
    STARTRACK_GUIDE_RANGE = 4    /* its numbers contradict each other */
};

/* Flags of a star. */
enum {
    STARTRACK_GUIDE_DOUBLE = 1,  /* others within the resolution; at their centre of light */
    STARTRACK_GUIDE_VARIABLE = 2,
    STARTRACK_GUIDE_STILL = 4    /* proper motion unknown, taken for zero */
};

typedef struct {
    const unsigned char *bytes;
    uint32_t stars, triangles, cells_x, cells_y;
    double epoch;              /* Julian year of the positions */
    double field;              /* of view that the patterns were made for */
    double limit;              /* magnitude of the faintest star, in the band of the instrument */
    double resolution;         /* stars closer than this are one */
    double smallest, largest;  /* longest side of a triangle */
} startrack_guide;

/* Check the bytes of a file; the guide refers to them and must not outlive them. */
int startrack_guide_open(startrack_guide *guide, const void *bytes, size_t size);

/* Direction, magnitude and flags of a star; direction, magnitude or flags may be NULL. */
void startrack_guide_star(const startrack_guide *guide, uint32_t star, double direction[3],
                          double *magnitude, unsigned *flags);

/* The star nearest to a direction, and its angle; angle may be NULL. */
uint32_t startrack_guide_nearest(const startrack_guide *guide, const double direction[3],
                                 double *angle);

/* Stars within a radius of a direction, in rising order. Returns their number, of which the first
 * `most` are in `found`. */
uint32_t startrack_guide_cone(const startrack_guide *guide, const double direction[3],
                              double radius, uint32_t *found, uint32_t most);

/* Triangles of stars like the triangle of three directions, in any order, on any axes: their codes
 * differ by at most `error`, and so does the logarithm of their longest sides. Each is three stars,
 * which belong to the directions seen[order[0]], seen[order[1]], seen[order[2]]. Returns their
 * number, of which the first `most` are in `found` and `order`. */
uint32_t startrack_guide_patterns(const startrack_guide *guide, const double seen[3][3],
                                  double error, uint32_t (*found)[3], int (*order)[3],
                                  uint32_t most);

/* Stars of directions on the axes of a camera, brightest first, at an unknown attitude.
 *
 * sigma    standard deviation of a direction along each axis
 * chance   accepted bound on the probability that chance makes such a match, such as 1e-5
 * star     [count], written: the star of each direction, or -1
 * turn     [9], written: matrix from ICRS to camera axes, row by row
 * Returns  the number of matched directions, 0 where none is accepted
 */
int startrack_guide_identify(const startrack_guide *guide, const double (*seen)[3], int count,
                             double sigma, double chance, int32_t *star, double turn[9]);

#endif
