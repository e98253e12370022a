// Vectors, matrices and spatial quantities, as nerd_core: angular part first, all in world axes about one origin. REAL
// is float or double. Compiles as CUDA C++ (NVRTC takes unmarked functions as device code) and, for tests without a
// GPU, as plain C++.

#ifdef __CUDACC_RTC__
#define FN static __device__ __forceinline__
#define BIG static __device__ __noinline__
#define TABLE static __device__ constexpr
#else
#include <cmath>
using std::sqrt; using std::sin; using std::cos; using std::exp; using std::expm1;
#define FN static inline
#define BIG static
#define TABLE static constexpr
#endif

typedef REAL real;

FN real least(real a, real b) { return a < b ? a : b; }
FN real most(real a, real b) { return a > b ? a : b; }
FN real size(real a) { return a < 0 ? -a : a; }
// In 32 bits the last digits may be off: exact functions branch at the ends of the range, and no load starts before a
// branch.
#ifdef __CUDACC_RTC__
FN float inverse_root(float a) { return rsqrtf(a); }
FN double inverse_root(double a) { return rsqrt(a); }
FN float inverse(float a) { return __fdividef(1, a); }
FN double inverse(double a) { return 1 / a; }
#else
FN real inverse_root(real a) { return 1 / sqrt(a); }
FN real inverse(real a) { return 1 / a; }
#endif
FN real infinite() { real x = (real)1e30; x *= x; x *= x; x *= x; return x * x; }

struct V3 { real x, y, z; };
FN V3 v3(real x, real y, real z) { V3 v = {x, y, z}; return v; }
FN V3 read3(const real* p) { return v3(p[0], p[1], p[2]); }
FN V3 operator+(V3 a, V3 b) { return v3(a.x + b.x, a.y + b.y, a.z + b.z); }
FN V3 operator-(V3 a, V3 b) { return v3(a.x - b.x, a.y - b.y, a.z - b.z); }
FN V3 operator*(V3 a, real k) { return v3(a.x * k, a.y * k, a.z * k); }
FN real dot(V3 a, V3 b) { return a.x * b.x + a.y * b.y + a.z * b.z; }
FN V3 cross(V3 a, V3 b) { return v3(a.y * b.z - a.z * b.y, a.z * b.x - a.x * b.z, a.x * b.y - a.y * b.x); }
FN real norm(V3 a) { return sqrt(dot(a, a)); }

// Row major.
struct M3 { real m[9]; };
FN V3 operator*(const M3& a, V3 v) {
    return v3(a.m[0] * v.x + a.m[1] * v.y + a.m[2] * v.z, a.m[3] * v.x + a.m[4] * v.y + a.m[5] * v.z,
              a.m[6] * v.x + a.m[7] * v.y + a.m[8] * v.z);
}
FN V3 back(const M3& a, V3 v) {
    return v3(a.m[0] * v.x + a.m[3] * v.y + a.m[6] * v.z, a.m[1] * v.x + a.m[4] * v.y + a.m[7] * v.z,
              a.m[2] * v.x + a.m[5] * v.y + a.m[8] * v.z);
}
FN M3 operator*(const M3& a, const M3& b) {
    M3 c;
    for (int i = 0; i < 3; i++)
        for (int j = 0; j < 3; j++)
            c.m[3 * i + j] = a.m[3 * i] * b.m[j] + a.m[3 * i + 1] * b.m[3 + j] + a.m[3 * i + 2] * b.m[6 + j];
    return c;
}

// Twists and their derivatives; wrenches and momenta.
struct Motion { V3 ang, lin; };
struct Wrench { V3 ang, lin; };
FN Motion motion(V3 ang, V3 lin) { Motion m = {ang, lin}; return m; }
FN Wrench wrench(V3 ang, V3 lin) { Wrench w = {ang, lin}; return w; }
FN Motion operator+(Motion a, Motion b) { return motion(a.ang + b.ang, a.lin + b.lin); }
FN Motion operator*(Motion a, real k) { return motion(a.ang * k, a.lin * k); }
FN Wrench operator+(Wrench a, Wrench b) { return wrench(a.ang + b.ang, a.lin + b.lin); }
FN Motion cross(Motion a, Motion b) { return motion(cross(a.ang, b.ang), cross(a.ang, b.lin) + cross(a.lin, b.ang)); }
FN real dot(Motion a, Wrench b) { return dot(a.ang, b.ang) + dot(a.lin, b.lin); }
FN V3 at(Motion m, V3 x) { return m.lin + cross(m.ang, x); }

// Inertia about the common origin: mass, mass x centre, and xx, yy, zz, xy, xz, yz.
struct Inertia { real mass; V3 moment; real i[6]; };
FN Wrench operator*(const Inertia& b, Motion m) {
    V3 w = m.ang;
    V3 turned = v3(b.i[0] * w.x + b.i[3] * w.y + b.i[4] * w.z, b.i[3] * w.x + b.i[1] * w.y + b.i[5] * w.z,
                   b.i[4] * w.x + b.i[5] * w.y + b.i[2] * w.z);
    return wrench(turned + cross(b.moment, m.lin), m.lin * b.mass - cross(b.moment, w));
}
FN Inertia none() { Inertia b = {0, {0, 0, 0}, {0, 0, 0, 0, 0, 0}}; return b; }
FN void add(Inertia& a, const Inertia& b) {
    a.mass += b.mass;
    a.moment = a.moment + b.moment;
    for (int k = 0; k < 6; k++) a.i[k] += b.i[k];
}

// Quaternions x y z w.
struct Q4 { real x, y, z, w; };
FN Q4 read4(const double* p) {
    const double n = 1 / sqrt(p[0] * p[0] + p[1] * p[1] + p[2] * p[2] + p[3] * p[3]);
    Q4 q = {(real)(p[0] * n), (real)(p[1] * n), (real)(p[2] * n), (real)(p[3] * n)};
    return q;
}
FN M3 matrix(Q4 q) {
    real x = q.x, y = q.y, z = q.z, w = q.w;
    M3 r = {{w * w + x * x - y * y - z * z, 2 * (x * y - w * z), 2 * (w * y + x * z), 2 * (w * z + x * y),
             w * w - x * x + y * y - z * z, 2 * (y * z - w * x), 2 * (x * z - w * y), 2 * (w * x + y * z),
             w * w - x * x - y * y + z * z}};
    return r;
}
// Rotates q by the rotation vector v, in world axes.
FN void turn(double* q, V3 v) {
    real angle = norm(v), half = (real)0.5 * angle;
    real s = angle > 0 ? sin(half) / angle : (real)0.5;
    Q4 a = {v.x * s, v.y * s, v.z * s, cos(half)}, b = read4(q);
    double x = a.w * b.x + a.x * b.w + a.y * b.z - a.z * b.y, y = a.w * b.y - a.x * b.z + a.y * b.w + a.z * b.x;
    double z = a.w * b.z + a.x * b.y - a.y * b.x + a.z * b.w, w = a.w * b.w - a.x * b.x - a.y * b.y - a.z * b.z;
    double n = 1.0 / sqrt(x * x + y * y + z * z + w * w);
    q[0] = x * n; q[1] = y * n; q[2] = z * n; q[3] = w * n;
}

// Sine and cosine of an angle.
FN void swing(real angle, real& s, real& c) {
#ifdef __CUDACC_RTC__
    sincos(angle, &s, &c);
#else
    s = sin(angle); c = cos(angle);
#endif
}

// Wraps an angle to [-pi, pi).
FN double wrapped(double x) {
    const double pi = 3.14159265358979323846;
    if (-pi <= x && x < pi) return x;
    const double y = fmod(x, 2 * pi);
    return y >= pi ? y - 2 * pi : y < -pi ? y + 2 * pi : y;
}

// conj(a) b, normalised; quaternions x y z w of any length.
FN void from_to(const double* a, const double* b, double* out) {
    out[0] = a[3] * b[0] - a[0] * b[3] - a[1] * b[2] + a[2] * b[1];
    out[1] = a[3] * b[1] + a[0] * b[2] - a[1] * b[3] - a[2] * b[0];
    out[2] = a[3] * b[2] - a[0] * b[1] + a[1] * b[0] - a[2] * b[3];
    out[3] = a[3] * b[3] + a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
    const double n = 1 / sqrt(out[0] * out[0] + out[1] * out[1] + out[2] * out[2] + out[3] * out[3]);
    for (int k = 0; k < 4; k++) out[k] *= n;
}

// v rotated by a unit quaternion (sign 1) or its inverse (-1).
FN void rotate(const double* q, const double* v, double sign, double* out) {
    const double x = sign * q[0], y = sign * q[1], z = sign * q[2], w = q[3];
    const double a = 2 * (y * v[2] - z * v[1]), b = 2 * (z * v[0] - x * v[2]), c = 2 * (x * v[1] - y * v[0]);
    out[0] = v[0] + w * a + y * c - z * b;
    out[1] = v[1] + w * b + z * a - x * c;
    out[2] = v[2] + w * c + x * b - y * a;
}

// a b, normalised.
FN void multiply(const double* a, const double* b, double* out) {
    const double conjugate[4] = {-a[0], -a[1], -a[2], a[3]};
    from_to(conjugate, b, out);
}
