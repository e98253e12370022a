// Random numbers, equal to rand_chacha's and rand's. Compiles as CUDA or plain C++.

#ifndef FN
#define FN static __device__ __forceinline__
#endif

FN void quarter(unsigned* x, int a, int b, int c, int d) {
    const int at[4][3] = {{a, b, d}, {c, d, b}, {a, b, d}, {c, d, b}}, turn[4] = {16, 12, 8, 7};
    for (int k = 0; k < 4; k++) {
        const int to = at[k][0], from = at[k][1], other = at[k][2];
        x[to] += x[from];
        const unsigned mixed = x[other] ^ x[to];
        x[other] = mixed << turn[k] | mixed >> (32 - turn[k]);
    }
}

// One block of ChaCha8 (Bernstein 2008) with a 64-bit counter and a 64-bit stream.
FN void chacha8(const unsigned long long key[4], unsigned long long counter, unsigned long long stream,
                unsigned out[16]) {
    const unsigned begin[16] = {
        0x61707865u, 0x3320646eu, 0x79622d32u, 0x6b206574u,
        (unsigned)key[0], (unsigned)(key[0] >> 32), (unsigned)key[1], (unsigned)(key[1] >> 32),
        (unsigned)key[2], (unsigned)(key[2] >> 32), (unsigned)key[3], (unsigned)(key[3] >> 32),
        (unsigned)counter, (unsigned)(counter >> 32), (unsigned)stream, (unsigned)(stream >> 32)};
    for (int k = 0; k < 16; k++) out[k] = begin[k];
    for (int round = 0; round < 4; round++) {
        for (int k = 0; k < 4; k++) quarter(out, k, 4 + k, 8 + k, 12 + k);
        for (int k = 0; k < 4; k++) quarter(out, k, 4 + (k + 1) % 4, 8 + (k + 2) % 4, 12 + (k + 3) % 4);
    }
    for (int k = 0; k < 16; k++) out[k] += begin[k];
}

// Uniform number in [0, 1), from two words.
FN double unit(const unsigned* words) {
    return (double)(((unsigned long long)words[1] << 32 | words[0]) >> 11) * 0x1p-53;
}
