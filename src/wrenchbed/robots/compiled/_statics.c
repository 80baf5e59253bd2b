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

#define LAYOUT 2 /* of the constants; `statics.py` refuses another */
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

/* A five-bar: cosines and sines of both drives, D-B, its square, D-E along and across it, E. */
typedef struct {
    double ca[BLOCK], sa[BLOCK], cc[BLOCK], sc[BLOCK], ex[BLOCK], ey[BLOCK], square[BLOCK];
    double along[BLOCK], across[BLOCK], lx[BLOCK], ly[BLOCK], px[BLOCK], py[BLOCK];
    double tip_y[BLOCK], tip_z[BLOCK], link_y[BLOCK], link_z[BLOCK];
} Bar;

/* Between both five-bars, and the wrist: the span's direction, the first distal link turned by q6,
   cosines and sines of gamma, beta and alpha, gravity after each of these turns. */
typedef struct {
    double dy[BLOCK], dz[BLOCK], apart[BLOCK], uy[BLOCK], uz[BLOCK], lc[BLOCK], ls[BLOCK];
    double c[BLOCK], s[BLOCK], c_gamma[BLOCK], s_gamma[BLOCK], c_beta[BLOCK], s_beta[BLOCK];
    double c_alpha[BLOCK], s_alpha[BLOCK], y1[BLOCK], z1[BLOCK], x2[BLOCK];
    double x[BLOCK], y[BLOCK], z[BLOCK];
} Wrist;

/* half, L1, L3, L4^2 - L2^2, L4^2, sine, cosine and middle of A-C, both zeros; Equations 2-11. */
INLINE void five_bar(int size, Py_ssize_t n, const double *q, const double *p, Bar *b)
{
    double angle[BLOCK];
    angles(size, n, q, MEDRUE_JOINTS, p[9], angle);
    sines(size, angle, b->sa, b->ca);
    angles(size, n, q + 1, MEDRUE_JOINTS, p[10], angle);
    sines(size, angle, b->sc, b->cc);
    for (int i = 0; i < size; i++) {
        double dx = p[2] * b->cc[i] - p[0], dy = p[2] * b->sc[i];
        double ex = p[0] + p[1] * b->ca[i] - dx, ey = p[1] * b->sa[i] - dy;
        double square = ex * ex + ey * ey, along = (p[3] / square + 1.0) * 0.5;
        double far = p[4] / square, across = root(far - along * along, far);
        double lx = along * ex - across * ey, ly = along * ey + across * ex;
        double px = dx + lx, py = dy + ly;
        b->ex[i] = ex, b->ey[i] = ey, b->square[i] = square;
        b->along[i] = along, b->across[i] = across;
        b->lx[i] = lx, b->ly[i] = ly, b->px[i] = px, b->py[i] = py;
        b->tip_y[i] = p[5] * px + p[6] * py + p[7];
        b->tip_z[i] = p[5] * py - p[6] * px + p[8];
        b->link_y[i] = p[5] * lx + p[6] * ly;
        b->link_z[i] = p[5] * ly - p[6] * lx;
    }
}

/* d41 + d42, L14 and dq6, then both five-bars; Equations 12-16. */
INLINE void wrist(int size, Py_ssize_t n, const double *q, const double *p, Bar *left, Bar *right,
                  Wrist *w)
{
    double angle[BLOCK], span = p[OWN], length = p[OWN + 1];
    five_bar(size, n, q + 1, p + BARS, left);
    five_bar(size, n, q + 3, p + BARS + BAR_SIZE, right);
    angles(size, n, q + 5, MEDRUE_JOINTS, p[OWN + 2], angle);
    sines(size, angle, w->s, w->c);
    for (int i = 0; i < size; i++) {
        double dy = right->tip_y[i] - left->tip_y[i], dz = right->tip_z[i] - left->tip_z[i];
        double apart = sqrt(span * span + dy * dy + dz * dz), uy = dy / apart, uz = dz / apart;
        double lc = left->link_y[i] / length, ls = left->link_z[i] / length;
        double c_gamma = lc * w->c[i] - ls * w->s[i], s_gamma = ls * w->c[i] + lc * w->s[i];
        double s_alpha = uy * c_gamma + uz * s_gamma, c_alpha = root(1.0 - s_alpha * s_alpha, 1.0);
        double psi = uy * s_gamma - uz * c_gamma, s_beta = psi / c_alpha;
        double c_beta = root(c_alpha * c_alpha - psi * psi, 1.0) / c_alpha;
        double y1 = c_gamma * p[1] + s_gamma * p[2], z1 = c_gamma * p[2] - s_gamma * p[1];
        double x2 = c_beta * p[0] - s_beta * z1;
        w->dy[i] = dy, w->dz[i] = dz, w->apart[i] = apart, w->uy[i] = uy, w->uz[i] = uz;
        w->lc[i] = lc, w->ls[i] = ls, w->c_gamma[i] = c_gamma, w->s_gamma[i] = s_gamma;
        w->c_beta[i] = c_beta, w->s_beta[i] = s_beta;
        w->c_alpha[i] = c_alpha, w->s_alpha[i] = s_alpha;
        w->y1[i] = y1, w->z1[i] = z1, w->x2[i] = x2;
        w->x[i] = c_alpha * x2 + s_alpha * y1;
        w->y[i] = c_alpha * y1 - s_alpha * x2;
        w->z[i] = c_beta * z1 + s_beta * p[0];
    }
}

INLINE void medrue_block(int size, Py_ssize_t n, const double *q, const double *p, double *out)
{
    Bar left, right;
    Wrist w;
    wrist(size, n, q, p, &left, &right, &w);
    reading(size, n, p, w.x, w.y, w.z, out);
}

/* Slopes of a five-bar's tip and distal link as its constants change by d. */
INLINE void bar_slopes(const Bar *b, int i, const double *p, const double *d, double *tip_y,
                       double *tip_z, double *link_y, double *link_z)
{
    double dx = d[2] * b->cc[i] - p[2] * b->sc[i] * d[10] - d[0];
    double dy = d[2] * b->sc[i] + p[2] * b->cc[i] * d[10];
    double ex = d[0] + d[1] * b->ca[i] - p[1] * b->sa[i] * d[9] - dx;
    double ey = d[1] * b->sa[i] + p[1] * b->ca[i] * d[9] - dy;
    double a = b->along[i], h = b->across[i], square = 2.0 * (b->ex[i] * ex + b->ey[i] * ey);
    double along = 0.5 * (d[3] - (2.0 * a - 1.0) * square) / b->square[i];
    double far = (d[4] - (a * a + h * h) * square) / b->square[i];
    double across = (0.5 * far - a * along) / h;
    double lx = along * b->ex[i] + a * ex - across * b->ey[i] - h * ey;
    double ly = along * b->ey[i] + a * ey + across * b->ex[i] + h * ex;
    double px = dx + lx, py = dy + ly;
    *tip_y = d[5] * b->px[i] + p[5] * px + d[6] * b->py[i] + p[6] * py + d[7];
    *tip_z = d[5] * b->py[i] + p[5] * py - d[6] * b->px[i] - p[6] * px + d[8];
    *link_y = d[5] * b->lx[i] + p[5] * lx + d[6] * b->ly[i] + p[6] * ly;
    *link_z = d[5] * b->ly[i] + p[5] * ly - d[6] * b->lx[i] - p[6] * lx;
}

/* Slopes (n, 6) of the reading as all constants change by d: forward differentiation. */
INLINE void medrue_slopes_block(int size, Py_ssize_t n, const double *p, const double *d,
                                const Bar *left, const Bar *right, const Wrist *w, double *out)
{
    const double *last = p + LAST_TURN, *turned = d + LAST_TURN, *tool = p + TOOL, *more = d + TOOL;
    double rows[BLOCK][6];
    for (int i = 0; i < size; i++) {
        double ly, lz, ky, kz, ry, rz, jy, jz;
        bar_slopes(left, i, p + BARS, d + BARS, &ly, &lz, &ky, &kz);
        bar_slopes(right, i, p + BARS + BAR_SIZE, d + BARS + BAR_SIZE, &ry, &rz, &jy, &jz);
        double dy = ry - ly, dz = rz - lz, uy = w->uy[i], uz = w->uz[i];
        double apart = (p[OWN] * d[OWN] + w->dy[i] * dy + w->dz[i] * dz) / w->apart[i];
        double vy = (dy - uy * apart) / w->apart[i], vz = (dz - uz * apart) / w->apart[i];
        double lc = (ky - w->lc[i] * d[OWN + 1]) / p[OWN + 1];
        double ls = (kz - w->ls[i] * d[OWN + 1]) / p[OWN + 1];
        double cg = w->c_gamma[i], sg = w->s_gamma[i];
        double dcg = lc * w->c[i] - ls * w->s[i] - sg * d[OWN + 2];
        double dsg = ls * w->c[i] + lc * w->s[i] + cg * d[OWN + 2];
        double ca = w->c_alpha[i], sa = w->s_alpha[i], cb = w->c_beta[i], sb = w->s_beta[i];
        double dsa = vy * cg + uy * dcg + vz * sg + uz * dsg, dca = -sa * dsa / ca;
        double dsb = (vy * sg + uy * dsg - vz * cg - uz * dcg - sb * dca) / ca, dcb = -sb * dsb / cb;
        double y1 = dcg * p[1] + cg * d[1] + dsg * p[2] + sg * d[2];
        double z1 = dcg * p[2] + cg * d[2] - dsg * p[1] - sg * d[1];
        double x2 = dcb * p[0] + cb * d[0] - dsb * w->z1[i] - sb * z1;
        double x = w->x[i], y = w->y[i], z = w->z[i];
        double dx = dca * w->x2[i] + ca * x2 + dsa * w->y1[i] + sa * y1;
        double dyy = dca * w->y1[i] + ca * y1 - dsa * w->x2[i] - sa * x2;
        double dzz = dcb * w->z1[i] + cb * z1 + dsb * p[0] + sb * d[0];
        double t[3], dt[3], f[3], df[3];
        for (int k = 0; k < 3; k++) {
            double g = last[k] * x + last[3 + k] * y + last[6 + k] * z;
            double dg = last[k] * dx + last[3 + k] * dyy + last[6 + k] * dzz
                      + turned[k] * x + turned[3 + k] * y + turned[6 + k] * z;
            t[k] = tool[0] * g, dt[k] = more[0] * g + tool[0] * dg;
            f[k] = t[k] + tool[4] * g, df[k] = dt[k] + more[4] * g + tool[4] * dg;
        }
        for (int k = 0; k < 3; k++) {
            const double *gain = p + GAIN + 3 * k, *louder = d + GAIN + 3 * k;
            int a = (k + 1) % 3, b = (k + 2) % 3;
            rows[i][k] = gain[0] * df[0] + gain[1] * df[1] + gain[2] * df[2] + louder[0] * f[0]
                       + louder[1] * f[1] + louder[2] * f[2] + d[BIAS + k];
            rows[i][3 + k] = more[1 + a] * t[b] + tool[1 + a] * dt[b] - more[1 + b] * t[a]
                           - tool[1 + b] * dt[a] + d[BIAS + 3 + k];
        }
    }
    memcpy(out, rows, n * sizeof rows[0]);
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

/* out (columns, count, 6) of slopes (columns, MEDRUE_SIZE). */
EACH_PROCESSOR static void medrue_slopes(const double *q, Py_ssize_t count, const double *p,
                                         const double *slopes, Py_ssize_t columns, double *out)
{
    Bar left, right;
    Wrist w;
    for (Py_ssize_t k = 0; k < count; k += SMALL) {
        Py_ssize_t n = count - k < SMALL ? count - k : SMALL;
        wrist(SMALL, n, q + k * MEDRUE_JOINTS, p, &left, &right, &w);
        for (Py_ssize_t j = 0; j < columns; j++)
            medrue_slopes_block(SMALL, n, p, slopes + j * MEDRUE_SIZE, &left, &right, &w,
                                out + 6 * (j * count + k));
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

enum Kind { CHAIN, MEDRUE, MEDRUE_SLOPES };

/* (q, joints, constants, out) and of slopes theirs too: q (count, joints), out ([columns,] count,
   6), contiguous; constants as bytes. */
static PyObject *run(PyObject *const *args, Py_ssize_t given, enum Kind kind)
{
    Py_buffer q, out;
    int slopes = kind == MEDRUE_SLOPES;
    if (given != 4 + slopes) return PyErr_Format(PyExc_TypeError, "q, joints, constants, out");
    long joints = PyLong_AsLong(args[1]);
    const char *packed = PyErr_Occurred() ? NULL : PyBytes_AsString(args[2]);
    const char *changes = packed && slopes ? PyBytes_AsString(args[4]) : NULL;
    if (PyErr_Occurred() || PyObject_GetBuffer(args[0], &q, PyBUF_SIMPLE)) return NULL;
    if (PyObject_GetBuffer(args[3], &out, PyBUF_WRITABLE)) {
        PyBuffer_Release(&q);
        return NULL;
    }
    const double *p = (const double *)packed, *d = (const double *)changes;
    Py_ssize_t size = PyBytes_Size(args[2]) / 8, row = 8 * joints, columns = 1;
    int fits = kind == CHAIN ? joints > 0 && whole(p, size, joints)
                             : joints == MEDRUE_JOINTS && size == MEDRUE_SIZE;
    if (fits && slopes) {
        Py_ssize_t bytes = PyBytes_Size(args[4]);
        columns = bytes / (8 * MEDRUE_SIZE);
        fits = bytes == columns * 8 * MEDRUE_SIZE;
    }
    Py_ssize_t count = fits ? q.len / row : 0;
    fits = fits && q.len == count * row && out.len == columns * count * 48;
    if (fits) {
        Py_BEGIN_ALLOW_THREADS
        if (slopes) medrue_slopes(q.buf, count, p, d, columns, out.buf);
        else if (kind == MEDRUE) medrue(q.buf, count, p, out.buf);
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
    return run(args, given, CHAIN);
}

static PyObject *py_medrue(PyObject *self, PyObject *const *args, Py_ssize_t given)
{
    return run(args, given, MEDRUE);
}

static PyObject *py_medrue_slopes(PyObject *self, PyObject *const *args, Py_ssize_t given)
{
    return run(args, given, MEDRUE_SLOPES);
}

#define FUNCTION(name) {#name, (PyCFunction)(void (*)(void))py_##name, METH_FASTCALL, NULL}
static PyMethodDef methods[] = {
    FUNCTION(chain), FUNCTION(medrue), FUNCTION(medrue_slopes), {NULL, NULL, 0, NULL}};

static int filled(PyObject *module)
{
    return PyModule_AddIntConstant(module, "LAYOUT", LAYOUT);
}

static PyModuleDef_Slot slots[] = {{Py_mod_exec, filled}, {0, NULL}};
static struct PyModuleDef statics = {
    PyModuleDef_HEAD_INIT, "_statics", NULL, 0, methods, slots, NULL, NULL, NULL};

PyMODINIT_FUNC PyInit__statics(void) { return PyModuleDef_Init(&statics); }
