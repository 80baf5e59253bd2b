/* The reading at rest in many poses of one robot: chains of hinges, and MedRUE.

   Plain numpy computes the same (`robots/chain.py`, `robots/medrue/kinematics.py`); `statics.py` calls this.
   Each operation is rounded as IEEE 754 says, in a fixed order and never fused, so a pose has the
   same bits alone, in any batch and on any processor. Build: `scripts/build_kernel.py`. */

#define Py_LIMITED_API 0x030b0000 /* one library for Python 3.11 and all later ones */
#define PY_SSIZE_T_CLEAN
#include <Python.h>
#include <math.h>
#include <stdint.h>
#include <string.h>

#define LAYOUT 1 /* of the constants; `statics.py` refuses another */
#define BLOCK 64 /* poses at once: what lies in the nearest cache */
#define SMALL 16 /* of the last ones: two to eight vectors of the processor */
#define INLINE static inline __attribute__((always_inline))
#if defined(__x86_64__) && defined(__gnu_linux__)
#define EACH_PROCESSOR __attribute__((target_clones("avx512f", "avx2", "default")))
#else
#define EACH_PROCESSOR
#endif

/* Constants: gravity in the first axes (3), mass, centre (3), the sensor's own mass, the last turn
   (9), the sensor's gains (9) and bias (6); then the robot's. */
enum { TOOL = 3, LAST_TURN = 8, GAIN = 17, BIAS = 26, OWN = 32 };
enum { HINGE_SIZE = 4, MEDRUE_JOINTS = 6, BARS = OWN + 3, BAR_SIZE = 11 };
enum { MEDRUE_SIZE = BARS + 2 * BAR_SIZE };

/* Sine and cosine: pi/2 in three parts of 33 bits and the polynomials of fdlibm
   (Sun Microsystems 1993, netlib.org/fdlibm: e_rem_pio2.c, k_sin.c, k_cos.c). */
static const double TWO_OVER_PI = 6.36619772367581382433e-01;
static const double HALF_PI[3] = {
    1.57079632673412561417e+00, 6.07710050630396597660e-11, 2.02226624879595063154e-21};
static const double SINE[6] = {
    -1.66666666666666324348e-01, 8.33333333332248946124e-03, -1.98412698298579493134e-04,
    2.75573137070700676789e-06, -2.50507602534068634195e-08, 1.58969099521155010221e-10};
static const double COSINE[6] = {
    4.16666666666666019037e-02, -1.38888888888741095749e-03, 2.48015872894767294178e-05,
    -2.75573143513906633035e-07, 2.08757232129817482790e-09, -1.13596475577881948265e-11};
static const double TO_INTEGER = 6755399441055744.0; /* 1.5 * 2^52: a sum's last bit is a unit */
static const double FAR = 4e5; /* [rad]: below, turns have 19 bits, so products above are exact */

/* A loop this near to where it cannot close is open: rounding alone never decides, so that numpy's
   Jacobian exists wherever a reading does. By definition: a thousand times the rounding. */
static const double OPEN = 1e-12;

INLINE double polynomial(const double *a, double z)
{
    return a[0] + z * (a[1] + z * (a[2] + z * (a[3] + z * (a[4] + z * a[5]))));
}

INLINE void sines(int size, const double *angle, double *s, double *c)
{
    int far = 0;
    for (int i = 0; i < size; i++) {
        double sum = angle[i] * TWO_OVER_PI + TO_INTEGER, turns = sum - TO_INTEGER;
        double r = ((angle[i] - turns * HALF_PI[0]) - turns * HALF_PI[1]) - turns * HALF_PI[2];
        double z = r * r, half = 0.5 * z, one = 1.0 - half;
        double sine = r + r * z * polynomial(SINE, z);
        double cosine = one + (((1.0 - one) - half) + z * z * polynomial(COSINE, z));
        uint64_t quarter, a, b;
        memcpy(&quarter, &sum, 8);
        memcpy(&a, &sine, 8);
        memcpy(&b, &cosine, 8);
        uint64_t swapped = (a ^ b) & -(quarter & 1);
        a ^= swapped ^ ((quarter & 2) << 62);
        b ^= swapped ^ (((quarter + 1) & 2) << 62);
        memcpy(&s[i], &a, 8);
        memcpy(&c[i], &b, 8);
        far |= !(fabs(angle[i]) < FAR);
    }
    for (int i = 0; far && i < size; i++)
        if (!(fabs(angle[i]) < FAR)) {
            s[i] = sin(angle[i]);
            c[i] = cos(angle[i]);
        }
}

/* Root of what is positive by more than rounding of terms of a size, else NaN. */
INLINE double root(double x, double terms) { return x > OPEN * terms ? sqrt(x) : NAN; }

/* One joint's values of n poses plus its zero; 0 behind the last. */
INLINE void angles(int size, Py_ssize_t n, const double *q, int joints, double zero, double *angle)
{
    if (n == size)
        for (int i = 0; i < size; i++) angle[i] = q[i * joints] + zero;
    else
        for (int i = 0; i < size; i++) angle[i] = i < n ? q[i * joints] + zero : 0.0;
}

/* Gravity in the last axes -> force and torque as the sensor reads them. */
INLINE void reading(int size, Py_ssize_t n, const double *p, const double *x, const double *y,
                    const double *z, double *out)
{
    const double *tool = p + TOOL, *last = p + LAST_TURN, *gain = p + GAIN, *bias = p + BIAS;
    double w[BLOCK][6];
    for (int i = 0; i < size; i++) {
        double gx = last[0] * x[i] + last[3] * y[i] + last[6] * z[i];
        double gy = last[1] * x[i] + last[4] * y[i] + last[7] * z[i];
        double gz = last[2] * x[i] + last[5] * y[i] + last[8] * z[i];
        double tx = tool[0] * gx, ty = tool[0] * gy, tz = tool[0] * gz;
        double fx = tx + tool[4] * gx, fy = ty + tool[4] * gy, fz = tz + tool[4] * gz;
        w[i][0] = gain[0] * fx + gain[1] * fy + gain[2] * fz + bias[0];
        w[i][1] = gain[3] * fx + gain[4] * fy + gain[5] * fz + bias[1];
        w[i][2] = gain[6] * fx + gain[7] * fy + gain[8] * fz + bias[2];
        w[i][3] = tool[2] * tz - tool[3] * ty + bias[3];
        w[i][4] = tool[3] * tx - tool[1] * tz + bias[4];
        w[i][5] = tool[1] * ty - tool[2] * tx + bias[5];
    }
    memcpy(out, w, n * sizeof w[0]);
}

/* Of each hinge: its column, its zero, cosine and sine of the twist behind it. */
INLINE void chain_block(int size, Py_ssize_t n, const double *q, int joints, const double *p,
                        int hinges, double *out)
{
    double x[BLOCK], y[BLOCK], z[BLOCK], s[BLOCK], c[BLOCK], angle[BLOCK];
    for (int i = 0; i < size; i++) x[i] = p[0], y[i] = p[1], z[i] = p[2];
    for (int k = 0; k < hinges; k++) {
        const double *hinge = p + OWN + HINGE_SIZE * k, ca = hinge[2], sa = hinge[3];
        angles(size, n, q + (int)hinge[0], joints, hinge[1], angle);
        sines(size, angle, s, c);
        for (int i = 0; i < size; i++) {
            double along = c[i] * x[i] + s[i] * y[i], across = c[i] * y[i] - s[i] * x[i];
            x[i] = along;
            y[i] = ca * across + sa * z[i];
            z[i] = ca * z[i] - sa * across;
        }
    }
    reading(size, n, p, x, y, z, out);
}

/* Tip E (y, z) of a five-bar in the base, and its second distal link D-E; Equations 2-11. */
INLINE void five_bar(int size, Py_ssize_t n, const double *q, const double *bar, double *tip_y,
                     double *tip_z, double *link_y, double *link_z)
{
    double angle[BLOCK], sa[BLOCK], ca[BLOCK], sc[BLOCK], cc[BLOCK];
    double half = bar[0], first = bar[1], third = bar[2], more = bar[3], square4 = bar[4];
    double s = bar[5], c = bar[6], middle_y = bar[7], middle_z = bar[8];
    angles(size, n, q, MEDRUE_JOINTS, bar[9], angle);
    sines(size, angle, sa, ca);
    angles(size, n, q + 1, MEDRUE_JOINTS, bar[10], angle);
    sines(size, angle, sc, cc);
    for (int i = 0; i < size; i++) {
        double dx = third * cc[i] - half, dy = third * sc[i];
        double ex = half + first * ca[i] - dx, ey = first * sa[i] - dy;
        double square = ex * ex + ey * ey, along = (more / square + 1.0) * 0.5;
        double far = square4 / square, across = root(far - along * along, far);
        double lx = along * ex - across * ey, ly = along * ey + across * ex;
        double px = dx + lx, py = dy + ly;
        tip_y[i] = s * px + c * py + middle_y;
        tip_z[i] = s * py - c * px + middle_z;
        link_y[i] = s * lx + c * ly;
        link_z[i] = s * ly - c * lx;
    }
}

/* d41 + d42, L14 and dq6, then both five-bars; Equations 12-16. */
INLINE void medrue_block(int size, Py_ssize_t n, const double *q, const double *p, double *out)
{
    double x[BLOCK], y[BLOCK], z[BLOCK], s[BLOCK], c[BLOCK], angle[BLOCK];
    double left_y[BLOCK], left_z[BLOCK], right_y[BLOCK], right_z[BLOCK];
    double link_y[BLOCK], link_z[BLOCK], other_y[BLOCK], other_z[BLOCK];
    double span = p[OWN], length = p[OWN + 1];
    five_bar(size, n, q + 1, p + BARS, left_y, left_z, link_y, link_z);
    five_bar(size, n, q + 3, p + BARS + BAR_SIZE, right_y, right_z, other_y, other_z);
    angles(size, n, q + 5, MEDRUE_JOINTS, p[OWN + 2], angle);
    sines(size, angle, s, c);
    for (int i = 0; i < size; i++) {
        double dy = right_y[i] - left_y[i], dz = right_z[i] - left_z[i];
        double apart = sqrt(span * span + dy * dy + dz * dz), uy = dy / apart, uz = dz / apart;
        double lc = link_y[i] / length, ls = link_z[i] / length;
        double c_gamma = lc * c[i] - ls * s[i], s_gamma = ls * c[i] + lc * s[i];
        double s_alpha = uy * c_gamma + uz * s_gamma, c_alpha = root(1.0 - s_alpha * s_alpha, 1.0);
        double psi = uy * s_gamma - uz * c_gamma, s_beta = psi / c_alpha;
        double c_beta = root(c_alpha * c_alpha - psi * psi, 1.0) / c_alpha;
        double y1 = c_gamma * p[1] + s_gamma * p[2], z1 = c_gamma * p[2] - s_gamma * p[1];
        double x2 = c_beta * p[0] - s_beta * z1;
        x[i] = c_alpha * x2 + s_alpha * y1;
        y[i] = c_alpha * y1 - s_alpha * x2;
        z[i] = c_beta * z1 + s_beta * p[0];
    }
    reading(size, n, p, x, y, z, out);
}

EACH_PROCESSOR static void chain(
    const double *q, Py_ssize_t count, int joints, const double *p, int hinges, double *out)
{
    Py_ssize_t k = 0;
    for (; k + BLOCK <= count; k += BLOCK)
        chain_block(BLOCK, BLOCK, q + k * joints, joints, p, hinges, out + 6 * k);
    for (; k < count; k += SMALL) {
        Py_ssize_t n = count - k < SMALL ? count - k : SMALL;
        chain_block(SMALL, n, q + k * joints, joints, p, hinges, out + 6 * k);
    }
}

EACH_PROCESSOR static void medrue(const double *q, Py_ssize_t count, const double *p, double *out)
{
    Py_ssize_t k = 0;
    for (; k + BLOCK <= count; k += BLOCK)
        medrue_block(BLOCK, BLOCK, q + k * MEDRUE_JOINTS, p, out + 6 * k);
    for (; k < count; k += SMALL) {
        Py_ssize_t n = count - k < SMALL ? count - k : SMALL;
        medrue_block(SMALL, n, q + k * MEDRUE_JOINTS, p, out + 6 * k);
    }
}

/* Whether constants are those of a chain of as many joints. */
static int whole(const double *p, Py_ssize_t size, long joints)
{
    if (size < OWN || (size - OWN) % HINGE_SIZE) return 0;
    for (const double *hinge = p + OWN; hinge < p + size; hinge += HINGE_SIZE)
        if (!(hinge[0] >= 0 && hinge[0] < joints)) return 0;
    return 1;
}

/* (q, joints, constants as bytes, out): out (count, 6) of q (count, joints), both contiguous. */
static PyObject *run(PyObject *const *args, Py_ssize_t given, int of_medrue)
{
    Py_buffer q, out;
    if (given != 4) return PyErr_Format(PyExc_TypeError, "expected q, joints, constants, out");
    long joints = PyLong_AsLong(args[1]);
    const char *packed = PyErr_Occurred() ? NULL : PyBytes_AsString(args[2]);
    if (!packed || PyObject_GetBuffer(args[0], &q, PyBUF_SIMPLE)) return NULL;
    if (PyObject_GetBuffer(args[3], &out, PyBUF_WRITABLE)) {
        PyBuffer_Release(&q);
        return NULL;
    }
    const double *p = (const double *)packed;
    Py_ssize_t size = PyBytes_Size(args[2]) / 8, row = 8 * joints;
    int fits = of_medrue ? joints == MEDRUE_JOINTS && size == MEDRUE_SIZE
                         : joints > 0 && whole(p, size, joints);
    Py_ssize_t count = fits ? q.len / row : 0;
    fits = fits && q.len == count * row && out.len == count * 48;
    if (fits) {
        Py_BEGIN_ALLOW_THREADS
        if (of_medrue) medrue(q.buf, count, p, out.buf);
        else chain(q.buf, count, (int)joints, p, (int)(size - OWN) / HINGE_SIZE, out.buf);
        Py_END_ALLOW_THREADS
    }
    PyBuffer_Release(&q);
    PyBuffer_Release(&out);
    if (!fits) return PyErr_Format(PyExc_ValueError, "q, constants and out do not fit together");
    Py_RETURN_NONE;
}

static PyObject *py_chain(PyObject *self, PyObject *const *args, Py_ssize_t given)
{
    return run(args, given, 0);
}

static PyObject *py_medrue(PyObject *self, PyObject *const *args, Py_ssize_t given)
{
    return run(args, given, 1);
}

static PyMethodDef methods[] = {
    {"chain", (PyCFunction)(void (*)(void))py_chain, METH_FASTCALL, NULL},
    {"medrue", (PyCFunction)(void (*)(void))py_medrue, METH_FASTCALL, NULL},
    {NULL, NULL, 0, NULL},
};

static int filled(PyObject *module)
{
    return PyModule_AddIntConstant(module, "LAYOUT", LAYOUT);
}

static PyModuleDef_Slot slots[] = {{Py_mod_exec, filled}, {0, NULL}};
static struct PyModuleDef statics = {
    PyModuleDef_HEAD_INIT, "_statics", NULL, 0, methods, slots, NULL, NULL, NULL};

PyMODINIT_FUNC PyInit__statics(void) { return PyModuleDef_Init(&statics); }
