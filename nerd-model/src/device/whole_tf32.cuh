// Products on tensor cores: operands rounded to TF32 (10-bit mantissa), sums in 32 bits.

// A number as an operand of a product: rounded, halves away from zero.
FN float factor(float x) {
#ifdef __CUDACC_RTC__
    unsigned bits;
    asm("cvt.rna.tf32.f32 %0, %1;" : "=r"(bits) : "f"(x));
    return __uint_as_float(bits);
#else
    if (!(x - x == 0)) return x;
    unsigned bits;
    std::memcpy(&bits, &x, 4);
    bits = (bits + 0x1000) & ~0x1fffu;
    std::memcpy(&x, &bits, 4);
    return x;
#endif
}

// Tokens of so many rows, as products read them.
template <int WIDE, int LX, int LY> FN void take(const float* x, float* y, int rows) {
    EACH(i, rows * WIDE) y[i / WIDE * LY + i % WIDE] = factor(x[i / WIDE * LX + i % WIDE]);
    SYNC;
}

// Where row `row` of a product is read, of a part of it `off` tokens away: `none`, which is zeros, beyond the ends of its window.
template <int LX> FN const float* beside(const float* x, int row, int off, int rows, const float* none) {
    const int other = row % T + off;
    return row < rows && other >= 0 && other < T ? x + (row + off) * LX : none;
}

// y = f(x W + bias), or y += where ADD, of the first `rows` rows. x has PARTS rows side by side, of WIDE numbers each and `off` tokens apart, and
// none beyond the ends of a window. Rows of x are LX numbers apart, of y LY. y may stand where x does, but where ADD.
template <int WIDE, int PARTS, int OUT, int LX, int LY, bool ADD, float (*F)(float)>
FN void linear(const float* x, int off, const float* w, const float* bias, float* y, const float* none, int rows) {
    auto put = [=](float& to, int c, float sum) {
        const float z = sum + (bias ? bias[c] : 0.0f);
        to = ADD ? to + z : F == same ? z : factor(F(z));
    };
#ifdef __CUDACC_RTC__
    // A warp has sixteen columns of all rows, which are two tiles of mma.m16n8k8. Within a tile of eight, columns and inner numbers are taken in an
    // order in which what a thread reads or writes stands side by side: thread t of four has inner numbers 2 t and 2 t + 1, column g of tile j is
    // 2 g + j.
    constexpr int TILES = (ROWS + 15) / 16, PAIRS = (OUT + 15) / 16, TURNS = (PAIRS + WARPS - 1) / WARPS;
    const int warp = threadIdx.x / 32, g = threadIdx.x % 32 / 4, t = threadIdx.x % 4;
    float sum[TURNS][TILES][2][4] = {};
#pragma unroll
    for (int part = 0; part < PARTS; part++) {
        const float* row[TILES][2];
#pragma unroll
        for (int m = 0; m < TILES; m++)
#pragma unroll
            for (int h = 0; h < 2; h++) row[m][h] = beside<LX>(x, m * 16 + h * 8 + g, (part - PARTS / 2) * off, rows, none);
#pragma unroll 4
        for (int c = 2 * t; c - 2 * t < WIDE; c += 8) {
            const bool has[2] = {WIDE % 8 == 0 || c < WIDE, WIDE % 8 == 0 || c + 1 < WIDE};
            float b[TURNS][2][2];                  // inner number, column
#pragma unroll
            for (int turn = 0; turn < TURNS; turn++)
#pragma unroll
                for (int k = 0; k < 2; k++) {
                    const int column = (turn * WARPS + warp) * 16 + 2 * g;
                    const float* from = w + (part * WIDE + c + k) * OUT + column;
                    if (OUT % 4 == 0) {
                        const float2 v = has[k] && column < OUT ? *(const float2*)from : make_float2(0, 0);
                        b[turn][k][0] = factor(v.x);
                        b[turn][k][1] = factor(v.y);
                    } else {
#pragma unroll
                        for (int j = 0; j < 2; j++) b[turn][k][j] = has[k] && column + j < OUT ? factor(from[j]) : 0;
                    }
                }
#pragma unroll
            for (int m = 0; m < TILES; m++) {
                float2 a[2];
#pragma unroll
                for (int h = 0; h < 2; h++) {
                    a[h] = *(const float2*)(row[m][h] + c);
                    if (!has[0]) a[h].x = 0;
                    if (!has[1]) a[h].y = 0;
                }
#pragma unroll
                for (int turn = 0; turn < TURNS; turn++)
#pragma unroll
                    for (int j = 0; j < 2; j++) {
                        float* d = sum[turn][m][j];
                        asm volatile("mma.sync.aligned.m16n8k8.row.col.f32.tf32.tf32.f32 {%0, %1, %2, %3}, {%4, %5, %6, %7}, {%8, %9}, {%0, %1, %2, %3};"
                            : "+f"(d[0]), "+f"(d[1]), "+f"(d[2]), "+f"(d[3])
                            : "r"(__float_as_uint(a[0].x)), "r"(__float_as_uint(a[1].x)), "r"(__float_as_uint(a[0].y)),
                              "r"(__float_as_uint(a[1].y)), "r"(__float_as_uint(b[turn][0][j])), "r"(__float_as_uint(b[turn][1][j])));
                    }
            }
        }
    }
    // y may stand where x does.
    if (!ADD) SYNC;
#pragma unroll
    for (int turn = 0; turn < TURNS; turn++)
#pragma unroll
        for (int m = 0; m < TILES; m++)
#pragma unroll
            for (int h = 0; h < 2; h++) {
                const int line = m * 16 + h * 8 + g, column = (turn * WARPS + warp) * 16 + 4 * t;
                float* to = y + line * LY + column;
                auto all = [&](float* at) {
#pragma unroll
                    for (int k = 0; k < 4; k++) if (column + k < OUT) put(at[k], column + k, sum[turn][m][k % 2][2 * h + k / 2]);
                };
                if (line >= rows || column >= OUT) continue;
                if (OUT % 4 == 0 && LY % 4 == 0) {
                    float4 four = ADD ? *(const float4*)to : make_float4(0, 0, 0, 0);
                    all(&four.x);
                    *(float4*)to = four;
                } else all(to);
            }
#else
    std::vector<float> sums;
    for (int row = 0; row < rows; row++)
        for (int column = 0; column < OUT; column++) {
            float sum = 0;
            for (int k = 0; k < PARTS * WIDE; k++) {
                const float* from = beside<LX>(x, row, (k / WIDE - PARTS / 2) * off, rows, none);
                sum += factor(from[k % WIDE]) * factor(w[k * OUT + column]);
            }
            sums.push_back(sum);
        }
    for (int k = 0; k < rows * OUT; k++) put(y[k / OUT * LY + k % OUT], k % OUT, sums[k]);
#endif
    SYNC;
}
