// Matrix products in f32, one window per block.

FN float factor(float x) { return x; }

struct Four { float x[4]; };

// Reads four numbers from an address that is a multiple of four. `weights` gives zeros for columns beyond the row's
// end.
FN Four four(const float* p) {
#ifdef __CUDACC_RTC__
    const float4 v = *(const float4*)p;
    return {{v.x, v.y, v.z, v.w}};
#else
    return {{p[0], p[1], p[2], p[3]}};
#endif
}
template <int OUT> FN Four weights(const float* row, int c) {
    if (OUT % 4 == 0) return four(row + c);
    Four b = {{0, 0, 0, 0}};
    for (int j = 0; j < 4; j++) if (c + j < OUT) b.x[j] = row[c + j];
    return b;
}

// y = f(x W + bias), or y += x W + bias with ADD; four rows and four columns per thread. A row of x joins PARTS rows of
// WIDE numbers, `off` tokens apart; rows beyond the ends of a window are zero. LX and LY are the row strides of x and
// y.
template <int WIDE, int PARTS, int OUT, int LX, int LY, bool ADD, float (*F)(float)>
FN void linear(const float* x, int off, const float* w, const float* bias, float* y, const float*, int) {
    constexpr int COLUMNS = (OUT + 3) / 4, QUADS = (T + 3) / 4;
    EACH(tile, QUADS * COLUMNS) {
        const int column = tile % COLUMNS * 4, row = tile / COLUMNS * 4;
        float sum[4][4] = {};
#pragma unroll
        for (int part = 0; part < PARTS; part++) {
            const float* rows[4];
            bool has[4];
#pragma unroll
            for (int i = 0; i < 4; i++) {
                const int other = row + i + (part - PARTS / 2) * off;
                has[i] = row + i < T && other >= 0 && other < T;
                rows[i] = x + (has[i] ? other : 0) * LX;
            }
#pragma unroll 2
            for (int c = 0; c + 4 <= WIDE; c += 4) {
                Four a[4];
#pragma unroll
                for (int i = 0; i < 4; i++) {
                    a[i] = four(rows[i] + c);
                    if (!has[i]) a[i] = {{0, 0, 0, 0}};
                }
#pragma unroll
                for (int k = 0; k < 4; k++) {
                    const Four b = weights<OUT>(w + (part * WIDE + c + k) * OUT, column);
#pragma unroll
                    for (int i = 0; i < 4; i++)
#pragma unroll
                        for (int j = 0; j < 4; j++) sum[i][j] += a[i].x[k] * b.x[j];
                }
            }
#pragma unroll
            for (int c = WIDE / 4 * 4; c < WIDE; c++) {
                const Four b = weights<OUT>(w + (part * WIDE + c) * OUT, column);
#pragma unroll
                for (int i = 0; i < 4; i++) {
                    const float a = has[i] ? rows[i][c] : 0.0f;
#pragma unroll
                    for (int j = 0; j < 4; j++) sum[i][j] += a * b.x[j];
                }
            }
        }
#pragma unroll
        for (int i = 0; i < 4; i++)
#pragma unroll
            for (int j = 0; j < 4; j++) {
                if (row + i >= T || column + j >= OUT) continue;
                float& to = y[(row + i) * LY + column + j];
                const float z = sum[i][j] + (bias ? bias[column + j] : 0.0f);
                to = ADD ? to + z : F(z);
            }
    }
    SYNC;
}
