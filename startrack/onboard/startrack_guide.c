/* See startrack_guide.h. */
#include "startrack_guide.h"

#include <math.h>
#include <string.h>

#define HEADER 64u
#define STAR 16u
#define VERSION 1u
#define UNIT (1.0 / 1073741824.0) /* of a coordinate: 2^-30 */
#define BRIGHT 16                 /* directions that form triangles, the brightest ones */
#define CANDIDATES 64u            /* of one triangle that are tested */
#define HYPOTHESES 20000          /* tested before the search ends */
#define FIRST 8.0                 /* sigma: match radius at the attitude of two stars */
#define LAST 4.0                  /* sigma: match radius at the attitude of all stars */
#define NOISE 3.5                 /* sigma: error of a code */
#define ROUNDS 3                  /* of matching and fitting */
#define TESTS 11.0                /* above the sum of 1 / n up to HYPOTHESES */

static uint32_t whole(const unsigned char *at, int bytes)
{
    uint32_t value = 0;
    while (bytes-- > 0)
        value = value << 8 | at[bytes];
    return value;
}

static double coordinate(const unsigned char *at)
{
    uint32_t value = whole(at, 4);
    return (value < 0x80000000u ? (double)value : (double)value - 4294967296.0) * UNIT;
}

/* CRC-32 of ISO-HDLC, as of zlib and PNG. */
static uint32_t checksum(const unsigned char *at, size_t size)
{
    uint32_t value = 0xffffffffu;
    while (size-- > 0) {
        int bit;
        value ^= *at++;
        for (bit = 0; bit < 8; bit++)
            value = value & 1 ? value >> 1 ^ 0xedb88320u : value >> 1;
    }
    return ~value;
}

static double dot(const double a[3], const double b[3])
{
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
}

static void cross(const double a[3], const double b[3], double out[3])
{
    out[0] = a[1] * b[2] - a[2] * b[1];
    out[1] = a[2] * b[0] - a[0] * b[2];
    out[2] = a[0] * b[1] - a[1] * b[0];
}

static double square(const double a[3], const double b[3])
{
    double x = a[0] - b[0], y = a[1] - b[1], z = a[2] - b[2];
    return x * x + y * y + z * z;
}

static double separation(const double a[3], const double b[3])
{
    double half = sqrt(square(a, b)) / 2;
    return 2 * asin(half < 1 ? half : 1);
}

static const unsigned char *star_at(const startrack_guide *guide, uint32_t star)
{
    return guide->bytes + HEADER + (size_t)star * STAR;
}

static const unsigned char *cell_at(const startrack_guide *guide, uint32_t cell)
{
    return star_at(guide, guide->stars) + (size_t)cell * 4;
}

static const unsigned char *triangle_at(const startrack_guide *guide, uint32_t triangle)
{
    return cell_at(guide, guide->cells_x * guide->cells_y + 1) + (size_t)triangle * 6;
}

static void place(const startrack_guide *guide, uint32_t star, double direction[3])
{
    int k;
    for (k = 0; k < 3; k++)
        direction[k] = coordinate(star_at(guide, star) + 4 * k);
}

static double height(const startrack_guide *guide, uint32_t star)
{
    return coordinate(star_at(guide, star) + 8);
}

/* The first star of at least this z, or the number of stars. */
static uint32_t first_from(const startrack_guide *guide, double z)
{
    uint32_t low = 0, high = guide->stars;
    while (low < high) {
        uint32_t middle = low + (high - low) / 2;
        if (height(guide, middle) < z)
            low = middle + 1;
        else
            high = middle;
    }
    return low;
}

int startrack_guide_open(startrack_guide *guide, const void *bytes, size_t size)
{
    const unsigned char *at = bytes;
    uint32_t k, cells, before = 0;
    double needed;
    if (size < HEADER || memcmp(at, "STARGUID", 8) != 0 || whole(at + 8, 4) != VERSION)
        return STARTRACK_GUIDE_FORMAT;
    if (whole(at + 12, 4) > size || whole(at + 12, 4) < HEADER)
        return STARTRACK_GUIDE_CUT;
    if (checksum(at + 20, whole(at + 12, 4) - 20) != whole(at + 16, 4))
        return STARTRACK_GUIDE_CHECKSUM;
    guide->bytes = at;
    guide->stars = whole(at + 20, 2);
    guide->cells_x = at[22];
    guide->cells_y = at[23];
    guide->triangles = whole(at + 24, 4);
    guide->limit = (double)whole(at + 28, 4) / 1000 - 100;
    guide->epoch = (double)whole(at + 32, 4) / 1e6;
    guide->field = (double)whole(at + 36, 4) * UNIT;
    guide->resolution = (double)whole(at + 40, 4) * UNIT;
    guide->smallest = (double)whole(at + 44, 4) * UNIT;
    guide->largest = (double)whole(at + 48, 4) * UNIT;
    cells = guide->cells_x * guide->cells_y;
    needed = HEADER + (double)STAR * guide->stars + 4.0 * (cells + 1) + 6.0 * guide->triangles;
    if (needed != (double)whole(at + 12, 4) || guide->stars == 0 || cells == 0)
        return STARTRACK_GUIDE_RANGE;
    for (k = 0; k <= cells; k++) {
        uint32_t start = whole(cell_at(guide, k), 4);
        if (start < before || start > guide->triangles)
            return STARTRACK_GUIDE_RANGE;
        before = start;
    }
    for (k = 0; k < 3 * guide->triangles; k++)
        if (whole(triangle_at(guide, 0) + (size_t)k * 2, 2) >= guide->stars)
            return STARTRACK_GUIDE_RANGE;
    return STARTRACK_GUIDE_GOOD;
}

void startrack_guide_star(const startrack_guide *guide, uint32_t star, double direction[3],
                          double *magnitude, unsigned *flags)
{
    const unsigned char *at = star_at(guide, star);
    if (direction != NULL)
        place(guide, star, direction);
    if (magnitude != NULL)
        *magnitude = ((double)whole(at + 12, 2) - 32768) / 1000;
    if (flags != NULL)
        *flags = whole(at + 14, 2);
}

uint32_t startrack_guide_nearest(const startrack_guide *guide, const double direction[3],
                                 double *angle)
{
    /* Outwards from the star of the same z, until z alone is farther than the best star. */
    uint32_t up = first_from(guide, direction[2]), down = up, best = 0;
    double nearest = 9, star[3];
    for (;;) {
        double above = up < guide->stars ? height(guide, up) - direction[2] : 9;
        double below = down > 0 ? direction[2] - height(guide, down - 1) : 9;
        uint32_t next = above <= below ? up : down - 1;
        double gap = above <= below ? above : below, apart;
        if (gap * gap > nearest || gap >= 9)
            break;
        place(guide, next, star);
        apart = square(star, direction);
        if (apart < nearest) {
            nearest = apart;
            best = next;
        }
        if (above <= below)
            up++;
        else
            down--;
    }
    if (angle != NULL)
        *angle = 2 * asin(nearest < 4 ? sqrt(nearest) / 2 : 1);
    return best;
}

uint32_t startrack_guide_cone(const startrack_guide *guide, const double direction[3],
                              double radius, uint32_t *found, uint32_t most)
{
    double chord = radius < 3.1415926535897931 ? 2 * sqrt((1 - cos(radius)) / 2) : 3, star[3];
    uint32_t count = 0, k;
    for (k = first_from(guide, direction[2] - chord); k < guide->stars; k++) {
        place(guide, k, star);
        if (star[2] > direction[2] + chord)
            break;
        if (square(star, direction) <= chord * chord) {
            if (count < most)
                found[count] = k;
            count++;
        }
    }
    return count;
}

/* Position of c over the base from a to b, in the plane that touches the sphere in its middle:
 * after Lang et al. (2010), Astron. J. 139, 1782, sect. 2.2, who take four stars. */
static void code(const double a[3], const double b[3], const double c[3], double out[2])
{
    double middle[3], base[3], across[3], depth, length, width;
    int k;
    for (k = 0; k < 3; k++) {
        middle[k] = a[k] + b[k];
        base[k] = b[k] - a[k];
    }
    cross(middle, base, across);
    length = dot(base, base);
    width = dot(middle, middle);
    depth = dot(c, middle);
    out[0] = 0.5 + 0.5 * dot(c, base) * width / (depth * length);
    out[1] = 0.5 * dot(c, across) * sqrt(width) / (depth * length);
}

static int cell_of(double value, double low, double size, int cells)
{
    double at = (value - low) / size;
    return at < 0 ? 0 : at >= cells ? cells - 1 : (int)at;
}

/* Triangles like (a, b, c), whose longest side is from a to b; returns the number so far. */
static uint32_t look_up(const startrack_guide *guide, const int names[3], const double wanted[2],
                        double longest, double error, uint32_t (*found)[3], int (*order)[3],
                        uint32_t most, uint32_t count)
{
    int nx = (int)guide->cells_x, ny = (int)guide->cells_y, i, j, k;
    double size = 0.5 / nx, low = -size * (ny / 2);
    int first = cell_of(wanted[1] - error, low, size, ny);
    int last = cell_of(wanted[1] + error, low, size, ny);
    for (i = cell_of(wanted[0] - error, 0, size, nx); i <= cell_of(wanted[0] + error, 0, size, nx);
         i++) {
        for (j = first; j <= last; j++) {
            uint32_t cell = (uint32_t)(i * ny + j), at = whole(cell_at(guide, cell), 4);
            uint32_t end = whole(cell_at(guide, cell + 1), 4);
            for (; at < end; at++) {
                double star[3][3], is[2], dx, dy;
                uint32_t name[3];
                for (k = 0; k < 3; k++) {
                    name[k] = whole(triangle_at(guide, at) + 2 * k, 2);
                    place(guide, name[k], star[k]);
                }
                code(star[0], star[1], star[2], is);
                dx = is[0] - wanted[0];
                dy = is[1] - wanted[1];
                if (dx * dx + dy * dy > error * error)
                    continue;
                if (fabs(log(longest / separation(star[0], star[1]))) > error)
                    continue;
                for (k = 0; k < 3 && count < most; k++) {
                    found[count][k] = name[k];
                    order[count][k] = names[k];
                }
                count++;
            }
        }
    }
    return count;
}

uint32_t startrack_guide_patterns(const startrack_guide *guide, const double seen[3][3],
                                  double error, uint32_t (*found)[3], int (*order)[3],
                                  uint32_t most)
{
    double side[3], longest = 0;
    uint32_t count = 0;
    int k;
    for (k = 0; k < 3; k++) {
        side[k] = separation(seen[k], seen[(k + 1) % 3]);
        longest = side[k] > longest ? side[k] : longest;
    }
    for (k = 0; k < 3; k++) {
        /* All orders whose base may be the longest side, and whose c may be nearer to a. */
        int names[3], turned[3];
        double is[2], other[2];
        if (side[k] < longest * (1 - error))
            continue;
        names[0] = turned[1] = k;
        names[1] = turned[0] = (k + 1) % 3;
        names[2] = turned[2] = (k + 2) % 3;
        code(seen[names[0]], seen[names[1]], seen[names[2]], is);
        other[0] = 1 - is[0];
        other[1] = -is[1];
        if (is[0] <= 0.5 + error)
            count = look_up(guide, names, is, longest, error, found, order, most, count);
        if (is[0] >= 0.5 - error)
            count = look_up(guide, turned, other, longest, error, found, order, most, count);
    }
    return count;
}

/* Three unit vectors as rows: along a + b, along b - a, normal to both. */
static void triad(const double a[3], const double b[3], double rows[3][3])
{
    int k, i;
    for (k = 0; k < 3; k++) {
        rows[0][k] = a[k] + b[k];
        rows[1][k] = b[k] - a[k];
    }
    for (i = 0; i < 2; i++) {
        double length = sqrt(dot(rows[i], rows[i]));
        for (k = 0; k < 3; k++)
            rows[i][k] /= length;
    }
    cross(rows[0], rows[1], rows[2]);
}

/* The rotation that takes stars a, b to directions u, v. */
static void align(const double a[3], const double b[3], const double u[3], const double v[3],
                  double turn[9])
{
    double from[3][3], to[3][3];
    int i, j, k;
    triad(a, b, from);
    triad(u, v, to);
    for (i = 0; i < 3; i++)
        for (j = 0; j < 3; j++)
            for (turn[3 * i + j] = 0, k = 0; k < 3; k++)
                turn[3 * i + j] += to[k][i] * from[k][j];
}

/* The star of each direction within a radius, -1 where there is none; one direction a star. */
static int match(const startrack_guide *guide, const double (*seen)[3], int count,
                 const double turn[9], double radius, int32_t *star)
{
    int matches = 0, i, j, k;
    for (i = 0; i < count; i++) {
        double back[3], angle;
        for (k = 0; k < 3; k++)
            back[k] = turn[k] * seen[i][0] + turn[3 + k] * seen[i][1] + turn[6 + k] * seen[i][2];
        star[i] = (int32_t)startrack_guide_nearest(guide, back, &angle);
        for (j = 0; j < i && star[j] != star[i]; j++)
            ;
        if (angle > radius || j < i)
            star[i] = -1;
        matches += star[i] >= 0;
    }
    return matches;
}

/* One Gauss-Newton step of Wahba's problem; 0 where the directions do not determine it. */
static int improve(const startrack_guide *guide, const double (*seen)[3], int count,
                   const int32_t *star, double turn[9])
{
    double normal[3][3] = {{0}}, right[3] = {0}, inverse[3][3], step[3], rows[3][3], scale;
    int i, j, k;
    for (i = 0; i < count; i++) {
        double at[3], is[3], lever[3];
        if (star[i] < 0)
            continue;
        place(guide, (uint32_t)star[i], at);
        for (k = 0; k < 3; k++)
            is[k] = dot(turn + 3 * k, at);
        cross(is, seen[i], lever);
        for (k = 0; k < 3; k++) {
            right[k] += lever[k];
            for (j = 0; j < 3; j++)
                normal[k][j] += (j == k) - is[k] * is[j];
        }
    }
    for (k = 0; k < 3; k++)
        cross(normal[(k + 1) % 3], normal[(k + 2) % 3], inverse[k]);
    scale = dot(normal[0], inverse[0]);
    if (!(scale > 0))
        return 0;
    for (k = 0; k < 3; k++) /* the inverse of a symmetric matrix is symmetric */
        step[k] = dot(inverse[k], right) / scale;
    scale = 1 + dot(step, step) / 4; /* Cayley: a rotation for any step */
    for (j = 0; j < 3; j++) {
        double column[3], once[3], twice[3];
        for (k = 0; k < 3; k++)
            column[k] = turn[3 * k + j];
        cross(step, column, once);
        cross(step, once, twice);
        for (k = 0; k < 3; k++)
            rows[k][j] = column[k] + (once[k] + twice[k] / 2) / scale;
    }
    memcpy(turn, rows, sizeof rows);
    return 1;
}

/* Bound on the probability that `extra` of `others` directions match by chance, times tests;
 * stars are taken to be randomly distributed, and so are false directions. */
static double by_chance(double each, int extra, int others, double tests)
{
    int k;
    for (k = 1; k <= extra; k++)
        tests *= each * (others - k + 1) / k;
    return tests;
}

int startrack_guide_identify(const startrack_guide *guide, const double (*seen)[3], int count,
                             double sigma, double chance, int32_t *star, double turn[9])
{
    int bright = count < BRIGHT ? count : BRIGHT, sum, i, j, k, c, tests = 0;
    /* The part of the sphere that the discs around all stars take. */
    double near = FIRST * sigma, each = guide->stars * near * near / 4;
    uint32_t found[CANDIDATES][3];
    int order[CANDIDATES][3];
    /* Brightest first: one bright false direction delays the search only a little. */
    for (sum = 3; sum <= 3 * bright - 6; sum++)
        for (i = 0; 3 * i + 3 <= sum; i++)
            for (j = i + 1; i + 2 * j + 1 <= sum; j++) {
                double three[3][3], longest = 0, error;
                k = sum - i - j;
                if (k >= bright)
                    continue;
                memcpy(three[0], seen[i], sizeof three[0]);
                memcpy(three[1], seen[j], sizeof three[1]);
                memcpy(three[2], seen[k], sizeof three[2]);
                for (c = 0; c < 3; c++) {
                    double side = separation(three[c], three[(c + 1) % 3]);
                    longest = side > longest ? side : longest;
                }
                if (longest < guide->smallest || longest > guide->largest)
                    continue;
                error = NOISE * sigma / longest;
                c = (int)startrack_guide_patterns(guide, (const double(*)[3])three, error, found,
                                                  order, CANDIDATES);
                for (c = c < (int)CANDIDATES ? c : (int)CANDIDATES; c-- > 0;) {
                    double a[3], b[3];
                    int matches, round;
                    tests++;
                    place(guide, found[c][0], a);
                    place(guide, found[c][1], b);
                    align(a, b, three[order[c][0]], three[order[c][1]], turn);
                    matches = match(guide, seen, count, turn, near, star);
                    if (matches < 4 || by_chance(each, matches - 3, count - 3, TESTS * tests) > chance)
                        continue;
                    for (round = 0; round < ROUNDS; round++)
                        if (improve(guide, seen, count, star, turn))
                            matches = match(guide, seen, count, turn, LAST * sigma, star);
                    if (matches >= 4)
                        return matches;
                }
                if (tests >= HYPOTHESES)
                    return 0;
            }
    return 0;
}
