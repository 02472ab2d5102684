/* FMI 2.0 for co-simulation around startrack_head.c; see startrack_head.h for the model.

   The declarations are those of the standard FMI 2.0 that this model uses (types platform
   "default"); variables have the numbers of modelDescription.xml. */
#include "startrack_head.h"
#include "startrack_head_data.h"

#include <stdlib.h>
#include <string.h>

#if defined _WIN32
#define EXPORT __declspec(dllexport)
#else
#define EXPORT __attribute__((visibility("default")))
#endif

enum { OK = 0, WARNING = 1, ERROR = 3 }; /* fmi2Status */
enum {
    RATE, SUN, MOON, LIMB, ORBIT, TRUE_X, TRUE_Y, TRUE_Z, TRUE_W, INPUTS,
    ERROR_X = INPUTS, ERROR_Y, ERROR_Z, MEASURED_X, MEASURED_Y, MEASURED_Z, MEASURED_W, REALS
};
enum { SEED = 0, VALID = 0 };

typedef struct {
    startrack_head head;
    double real[REALS];
    double frames; /* since the start */
    int seed, valid, started;
} instance;

static void clear(instance *one)
{
    int k;
    memset(one, 0, sizeof *one);
    for (k = SUN; k <= LIMB; k++)
        one->real[k] = 4.0;
    one->real[TRUE_W] = one->real[MEASURED_W] = 1.0;
    one->seed = 1;
}

static void frame(instance *one, double interval)
{
    double *real = one->real;
    one->valid = startrack_frame(&one->head, interval, real[RATE], real[SUN], real[MOON],
                                 real[LIMB], real[ORBIT], real + ERROR_X);
    startrack_measure(real + TRUE_X, real + ERROR_X, real + MEASURED_X);
    one->frames += 1.0;
}

EXPORT const char *fmi2GetTypesPlatform(void) { return "default"; }
EXPORT const char *fmi2GetVersion(void) { return "2.0"; }

EXPORT void *fmi2Instantiate(const char *name, int kind, const char *guid, const char *place,
                             const void *calls, int visible, int logging)
{
    instance *one;
    (void)name, (void)place, (void)calls, (void)visible, (void)logging;
    if (kind != 1 || !guid || strcmp(guid, STARTRACK_GUID)) /* 1: co-simulation */
        return NULL;
    one = malloc(sizeof *one);
    if (one)
        clear(one);
    return one;
}

EXPORT void fmi2FreeInstance(void *c) { free(c); }

EXPORT int fmi2SetDebugLogging(void *c, int on, size_t count, const char *const names[])
{
    (void)c, (void)on, (void)count, (void)names;
    return OK;
}

EXPORT int fmi2SetupExperiment(void *c, int tolerant, double tolerance, double start, int ends,
                               double stop)
{
    (void)c, (void)tolerant, (void)tolerance, (void)start, (void)ends, (void)stop;
    return OK;
}

EXPORT int fmi2EnterInitializationMode(void *c) { (void)c; return OK; }

EXPORT int fmi2ExitInitializationMode(void *c)
{
    instance *one = c;
    startrack_start(&one->head, (uint64_t)(int64_t)one->seed);
    one->started = 1;
    frame(one, STARTRACK_PERIOD);
    one->frames = 0.0; /* the frame of the start is number 0 */
    return OK;
}

EXPORT int fmi2Terminate(void *c) { (void)c; return OK; }
EXPORT int fmi2Reset(void *c) { clear(c); return OK; }

EXPORT int fmi2GetReal(void *c, const unsigned at[], size_t count, double value[])
{
    size_t k;
    for (k = 0; k < count; k++) {
        if (at[k] >= REALS)
            return ERROR;
        value[k] = ((instance *)c)->real[at[k]];
    }
    return OK;
}

EXPORT int fmi2SetReal(void *c, const unsigned at[], size_t count, const double value[])
{
    size_t k;
    for (k = 0; k < count; k++) {
        if (at[k] >= INPUTS)
            return ERROR;
        ((instance *)c)->real[at[k]] = value[k];
    }
    return OK;
}

EXPORT int fmi2GetInteger(void *c, const unsigned at[], size_t count, int value[])
{
    size_t k;
    for (k = 0; k < count; k++) {
        if (at[k] != SEED)
            return ERROR;
        value[k] = ((instance *)c)->seed;
    }
    return OK;
}

EXPORT int fmi2SetInteger(void *c, const unsigned at[], size_t count, const int value[])
{
    size_t k;
    for (k = 0; k < count; k++) {
        if (at[k] != SEED || ((instance *)c)->started)
            return ERROR;
        ((instance *)c)->seed = value[k];
    }
    return OK;
}

EXPORT int fmi2GetBoolean(void *c, const unsigned at[], size_t count, int value[])
{
    size_t k;
    for (k = 0; k < count; k++) {
        if (at[k] != VALID)
            return ERROR;
        value[k] = ((instance *)c)->valid;
    }
    return OK;
}

EXPORT int fmi2DoStep(void *c, double now, double step, int no_way_back)
{
    instance *one = c;
    (void)no_way_back;
    while ((one->frames + 1.0) * STARTRACK_PERIOD <= (now + step) * (1.0 + 1e-12) + 1e-12)
        frame(one, STARTRACK_PERIOD);
    return OK;
}

/* What the model has none of; tools look these names up. */
#define NONE(name, ...) EXPORT int name(void *c, __VA_ARGS__) { (void)c; return ERROR; }
NONE(fmi2SetBoolean, const unsigned *a, size_t n, const int *v)
NONE(fmi2GetString, const unsigned *a, size_t n, const char **v)
NONE(fmi2SetString, const unsigned *a, size_t n, const char *const *v)
NONE(fmi2GetFMUstate, void **s)
NONE(fmi2SetFMUstate, void *s)
NONE(fmi2FreeFMUstate, void **s)
NONE(fmi2SerializedFMUstateSize, void *s, size_t *n)
NONE(fmi2SerializeFMUstate, void *s, char *b, size_t n)
NONE(fmi2DeSerializeFMUstate, const char *b, size_t n, void **s)
NONE(fmi2GetDirectionalDerivative, const unsigned *u, size_t m, const unsigned *k, size_t n,
     const double *d, double *v)
NONE(fmi2SetRealInputDerivatives, const unsigned *a, size_t n, const int *o, const double *v)
NONE(fmi2GetRealOutputDerivatives, const unsigned *a, size_t n, const int *o, double *v)
NONE(fmi2GetStatus, int k, int *v)
NONE(fmi2GetRealStatus, int k, double *v)
NONE(fmi2GetIntegerStatus, int k, int *v)
NONE(fmi2GetBooleanStatus, int k, int *v)
NONE(fmi2GetStringStatus, int k, const char **v)
EXPORT int fmi2CancelStep(void *c) { (void)c; return ERROR; }
