// A residual network: a block has ROWS rows. Their residual stream stays in registers, as the sums of matrix products
// on tensor cores. Operands are f16 (10-bit mantissa, like TF32's), sums f32. Every matrix is E columns wide; narrower
// ones are padded. Each warp computes E / WARPS columns of all rows. Only that warp reads the weights of its columns,
// once, in residual.rs's order. It prefetches AHEAD steps of sixteen inner numbers.

constexpr int WIDE = 3;                                   // hidden units, in multiples of E
constexpr int TILES = E / 8 / WARPS, BANDS = ROWS / 16;   // tiles of mma.m16n8k16: of a warp's columns, of all rows
constexpr int LX = (TAKEN > E ? TAKEN : E) + 8, LH = E + 8;   // row strides that put eight rows into different banks
constexpr int STEPS = 3 * (TAKEN + (1 + WIDE * LAYERS) * E) / 16;

typedef unsigned short half;
struct Two { unsigned x, y; };

#ifdef __CUDACC_RTC__
constexpr int LINES = 2 * BANDS;   // rows of a thread
struct Sum { float x[BANDS][TILES][4]; };
struct Weights { const Two* at; Two ring[AHEAD][TILES]; };

FN float read(const float* p) { return __ldg(p); }
FN void put(half* to, float a, float b) {
    unsigned both;
    asm("cvt.rn.f16x2.f32 %0, %1, %2;" : "=r"(both) : "f"(b), "f"(a));
    *(unsigned*)to = both;
}
FN void put(half* to, float x) { asm("cvt.rn.f16.f32 %0, %1;" : "=h"(*to) : "f"(x)); }
FN float rest(float x) {
    float near;
    asm("{ .reg .b16 h; cvt.rn.f16.f32 h, %1; cvt.f32.f16 %0, h; }" : "=f"(near) : "f"(x));
    return x - near;
}

template <class F> FN void each(Sum& sum, F f) {
    const int warp = threadIdx.x / 32, g = threadIdx.x % 32 / 4, t = threadIdx.x % 4;
#pragma unroll
    for (int line = 0; line < LINES; line++)
#pragma unroll
        for (int j = 0; j < TILES; j++) {
            float* own = sum.x[line / 2][j] + line % 2 * 2;
            f(line, line * 8 + g, (warp * TILES + j) * 8 + 2 * t, own[0], own[1]);
        }
}

FN void ahead(Weights& w, int slot) {
#pragma unroll
    for (int j = 0; j < TILES; j++) {
        Two& own = w.ring[slot][j];
        asm volatile("ld.global.L1::no_allocate.v2.u32 {%0, %1}, [%2];"
                     : "=r"(own.x), "=r"(own.y)
                     : "l"(w.at + 32 * j)
                     : "memory");
    }
    w.at += 4 * E;
}
FN void begin(Weights& w, const float* first) {
    w.at = (const Two*)first + threadIdx.x / 32 * TILES * 32 + threadIdx.x % 32;
#pragma unroll
    for (int slot = 0; slot < AHEAD; slot++) ahead(w, slot);
}

// Loads sixteen numbers of all rows in the operand layout of mma.
FN void operands(unsigned (&a)[BANDS][4], unsigned from, int apart) {
#pragma unroll
    for (int m = 0; m < BANDS; m++)
        asm volatile("ldmatrix.sync.aligned.m8n8.x4.shared.b16 {%0, %1, %2, %3}, [%4];"
            : "=r"(a[m][0]), "=r"(a[m][1]), "=r"(a[m][2]), "=r"(a[m][3]) : "r"(from + 32 * m * apart));
}

// sum += x W over 16 N inner numbers; rows of x are LD apart.
template <int N, int LD> FN void product(const half* x, Weights& w, Sum& sum) {
    static_assert(N % AHEAD == 0, "the ring of weights turns whole");
    unsigned from = (unsigned)__cvta_generic_to_shared(x + threadIdx.x % 16 * LD + threadIdx.x % 32 / 16 * 8);
    unsigned a[2][BANDS][4];
    operands(a[0], from, LD);
#pragma unroll 1
    for (int step = 0; step < N; step += AHEAD) {
#pragma unroll
        for (int slot = 0; slot < AHEAD; slot++) {
            // Loads the operands of the next step; after the last step, unused numbers behind the row.
            operands(a[(slot + 1) % 2], from += 32, LD);
#pragma unroll
            for (int j = 0; j < TILES; j++)
#pragma unroll
                for (int m = 0; m < BANDS; m++) {
                    const unsigned* own = a[slot % 2][m];
                    float* d = sum.x[m][j];
                    asm("mma.sync.aligned.m16n8k16.row.col.f32.f16.f16.f32 "
                        "{%0, %1, %2, %3}, {%4, %5, %6, %7}, {%8, %9}, {%0, %1, %2, %3};"
                        : "+f"(d[0]), "+f"(d[1]), "+f"(d[2]), "+f"(d[3])
                        : "r"(own[0]), "r"(own[1]), "r"(own[2]), "r"(own[3]), "r"(w.ring[slot][j].x),
                          "r"(w.ring[slot][j].y));
                }
            ahead(w, slot);
            // Without this, the compiler delays all reads to the end of the loop body, just before their use.
            __syncwarp();
        }
    }
}
#else
constexpr int LINES = ROWS;
struct Sum { float x[ROWS][E]; };
struct Weights { const Two* at; };

FN float read(const float* p) { return *p; }
FN half rounded(float x) {
    const float size = std::fabs(x);
    int e = 0;
    const float part = std::frexp(size, &e);
    const int sign = std::signbit(x) ? 1 << 15 : 0;
    if (!(size < 65520)) return sign | (size == size ? 31 << 10 : 0x7e00);
    return sign
           | (size < 0x1p-14f ? (int)std::nearbyint(std::ldexp(size, 24))
                              : ((e + 14) << 10) + (int)std::nearbyint(part * 2048) - 1024);
}
FN float value(half h) {
    const int e = h >> 10 & 31, m = h & 1023;
    const float size = e == 31 ? (m ? NAN : INFINITY) : std::ldexp((float)(e ? m + 1024 : m), (e ? e : 1) - 25);
    return h >> 15 ? -size : size;
}
FN void put(half* to, float x) { *to = rounded(x); }
FN void put(half* to, float a, float b) { to[0] = rounded(a); to[1] = rounded(b); }
FN float rest(float x) { return x - value(rounded(x)); }

template <class F> FN void each(Sum& sum, F f) {
    for (int row = 0; row < ROWS; row++)
        for (int c = 0; c < E; c += 2) f(row, row, c, sum.x[row][c], sum.x[row][c + 1]);
}
FN void begin(Weights& w, const float* first) { w.at = (const Two*)first; }

template <int N, int LD> FN void product(const half* x, Weights& w, Sum& sum) {
    for (int step = 0; step < N; step++, w.at += 4 * E)
        for (int c = 0; c < E; c++)
            for (int k = 0; k < 16; k++) {
                const Two two = w.at[c / 8 * 32 + c % 8 * 4 + k % 8 / 2];
                const float b = value((k < 8 ? two.x : two.y) >> k % 2 * 16);
                for (int row = 0; row < ROWS; row++) sum.x[row][c] += value(x[row * LD + 16 * step + k]) * b;
            }
}
#endif

// sum += x W in nearly f32: rows and matrix are each f16 plus a rounding residual. The product of the two residuals is
// left out. Afterwards all threads may write rows.
template <int N> FN void exact(const half* x, const half* left, Weights& w, Sum& sum) {
#pragma unroll 1
    for (int part = 0; part < 3; part++) product<N, LX>(part < 2 ? x : left, w, sum);
    SYNC;
}

FN void fill(Sum& sum, const float* bias) {
    each(sum, [&](int, int, int c, float& a, float& b) {
        a = bias ? read(bias + c) : 0;
        b = bias ? read(bias + c + 1) : 0;
    });
}

// Writes two numbers of a row as f16, and their rounding residuals if `left` is not null.
FN void put(half* to, half* left, float a, float b) {
    put(to, a, b);
    if (left) put(left, rest(a), rest(b));
}

// Sums of f over each row, across all warps.
template <class F> FN void total(Sum& x, float* parts, float* all, F f) {
    for (int line = 0; line < LINES; line++) all[line] = 0;
    each(x, [&](int line, int, int, float& a, float& b) { all[line] += f(line, a) + f(line, b); });
#ifdef __CUDACC_RTC__
    const int warp = threadIdx.x / 32, g = threadIdx.x % 32 / 4;
#pragma unroll
    for (int line = 0; line < LINES; line++) {
        all[line] += __shfl_xor_sync(~0u, all[line], 1);
        all[line] += __shfl_xor_sync(~0u, all[line], 2);
        if (threadIdx.x % 4 == 0) parts[(line * 8 + g) * WARPS + warp] = all[line];
    }
    SYNC;
#pragma unroll
    for (int line = 0; line < LINES; line++) {
        all[line] = 0;
#pragma unroll
        for (int k = 0; k < WARPS; k++) all[line] += parts[(line * 8 + g) * WARPS + k];
    }
#endif
}

// y = weight (x - mean) / sqrt(variance + 1e-5).
FN void norm(Sum& x, const float* weight, float* parts, half* y, half* left) {
    float mean[LINES], scale[LINES];
    total(x, parts, mean, [](int, float x) { return x; });
    for (int line = 0; line < LINES; line++) mean[line] /= E;
    total(x, parts + ROWS * WARPS, scale, [&](int line, float x) { return (x - mean[line]) * (x - mean[line]); });
    for (int line = 0; line < LINES; line++) scale[line] = 1 / sqrtf(scale[line] / E + 1e-5f);
    each(x, [&](int line, int row, int c, float& a, float& b) {
        const float one = read(weight + c) * (a - mean[line]) * scale[line],
                    two = read(weight + c + 1) * (b - mean[line]) * scale[line];
        put(y + row * LX + c, left ? left + row * LX + c : 0, one, two);
    });
    SYNC;
}

FN void pass(const float* w, const float* tokens, float* out, float* s, int rows) {
    // Activations alternate between two buffers. At the start and the end of the pass, the same memory holds the
    // rounding residuals of x.
    half *x = (half*)s, *h = x + ROWS * LX;
    float* parts = (float*)(h + ROWS * (LX > 2 * LH ? LX : 2 * LH));
    const float* vectors = w + (STEPS + AHEAD) * 8 * E;   // E numbers each
    Weights weights;
    begin(weights, w);
    EACH(i, ROWS * TAKEN / 2) {
        const int row = i / (TAKEN / 2), c = i % (TAKEN / 2) * 2, at = row * LX + c;
        const float* from = tokens + row * INPUTS + c;
        const bool has = row < rows && c < INPUTS;
        put(x + at, h + at, has ? from[0] : 0, has ? from[1] : 0);
    }
    SYNC;
    Sum stream, wide;
    fill(stream, vectors);
    exact<TAKEN / 16>(x, h, weights, stream);
#pragma unroll 1
    for (int layer = 0; layer < LAYERS; layer++) {
        norm(stream, vectors += E, parts, x, 0);
#pragma unroll 1
        for (int k = 0; k < WIDE; k++) {
            // The buffer used two steps before, which all threads have read.
            half* here = h + k % 2 * ROWS * LH;
#pragma unroll 1
            for (int part = 0; part < 2; part++) {
                fill(wide, 0);
                product<E / 16, LX>(x, weights, wide);
                // a and b are the two factors of a gated unit.
                each(wide, [&](int, int row, int c, float& a, float& b) {
                    put(here + row * LH + (part * E + c) / 2, gelu(a) * b);
                });
            }
            SYNC;
            product<E / 16, LH>(here, weights, stream);
        }
    }
    norm(stream, vectors += E, parts, x, h);
    fill(wide, vectors += E);
    exact<E / 16>(x, h, weights, wide);
    each(wide, [&](int, int row, int c, float& a, float& b) {
        if (row < rows && c < OUTPUTS) out[row * OUTPUTS + c] = a;
        if (row < rows && c + 1 < OUTPUTS) out[row * OUTPUTS + c + 1] = b;
    });
}
