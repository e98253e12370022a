//! Attention of one new token to the last ones of its environment, whole vectors at a time.
//!
//! Columns of queries, keys and values are ordered `[column of a head][head]`, and cut in tiles of a few vectors that hold every
//! head equally often. So products are summed tile on tile, and never across a vector until a last, short sum.

use pulp::{Arch, Simd, WithSimd};

use crate::program::cpu::Lanes;
use crate::program::cpu::elementwise::exp;
use crate::program::{Op, Program, Step};
use crate::transformer::TransformerConfig;

/// Most vectors of a tile.
const MOST: usize = 64;

/// The order of columns.
pub struct Columns {
    /// Columns of a query: E, and zeros for heads that are there to fill tiles.
    pub width: usize,
    /// Heads with those.
    pub heads: usize,
    real: usize,
    d: usize,
    vectors: usize,
}

impl Columns {
    /// For a network on this processor.
    pub fn new(c: &TransformerConfig) -> Self {
        let (real, d, lanes) = (c.heads, c.embedding / c.heads, Arch::new().dispatch(Lanes));
        // Three or four vectors are what registers hold twice.
        let sizes = || [4, 3, 2, 1].into_iter().chain(5..=MOST);
        let fits = |h: usize, v: usize| (v * lanes).is_multiple_of(h) && (h * d).is_multiple_of(v * lanes);
        let found = (real..=MOST).find_map(|h| sizes().find(|v| fits(h, *v)).map(|v| (h, v)));
        let (heads, vectors) = found.unwrap_or((MOST, MOST / lanes));
        Self { width: heads * d, heads, real, d, vectors }
    }

    /// The program with queries, keys, values and what is mixed of them in this order; its parameters likewise, none of it zeros.
    pub fn arrange(&self, mut program: Program, flat: &[f32]) -> (Program, Vec<f32>) {
        let starts = program.starts();
        let mut tensors: Vec<Vec<f32>> = starts.windows(2).map(|w| flat[w[0]..w[1]].to_vec()).collect();
        let attentions: Vec<Step> = program.steps.iter().filter(|step| matches!(step.op, Op::Attend { .. })).copied().collect();
        for Step { from, to, .. } in attentions {
            (program.widths[from.0], program.widths[to.0]) = (3 * self.width, self.width);
            for step in &program.steps {
                let Op::Linear { weight, .. } = step.op else { continue };
                let (spec, values) = (&mut program.tensors[weight.0], &mut tensors[weight.0]);
                let e = self.real * self.d;
                if step.to == from {
                    let part = |part: &[f32]| (0..self.width).map(|i| self.source(i).map_or(0.0, |s| part[s])).collect::<Vec<_>>();
                    *values = values.chunks_exact(e).flat_map(part).collect();
                    spec.shape[1] = 3 * self.width;
                } else if step.from == to {
                    let (rows, out) = (std::mem::take(values), spec.shape[1]);
                    let row = |i: usize| self.source(i).map_or(vec![0.0; out], |s| rows[s * out..][..out].to_vec());
                    *values = (0..self.width).flat_map(row).collect();
                    spec.shape[0] = self.width;
                }
            }
        }
        (program, tensors.concat())
    }

    /// The network's column that stands in this one, if any does.
    fn source(&self, column: usize) -> Option<usize> {
        let (m, head) = (column / self.heads, column % self.heads);
        (head < self.real).then_some(head * self.d + m)
    }
}

/// One layer's attention for a block of environments.
pub struct Attend<'a> {
    pub columns: &'a Columns,
    /// Environments in order, and how many tokens each had before this one.
    pub envs: &'a mut dyn Iterator<Item = (usize, usize)>,
    /// Keys and values of every environment, `[env][layer][2][history][width]`.
    pub rings: &'a mut [f32],
    pub layer: usize,
    pub layers: usize,
    pub history: usize,
    /// Queries, keys and values, not turned, `[row][3][width]`.
    pub qkv: &'a mut [f32],
    /// `[row][2][width / 2]` cosines and sines.
    pub turns: &'a [f32],
    /// Mixed values, `[row][width]`.
    pub out: &'a mut [f32],
    pub scratch: &'a mut Vec<f32>,
}

impl WithSimd for Attend<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        // Numbers that the compiler knows become registers.
        match self.columns.vectors {
            3 => self.tiles(simd, 3),
            4 => self.tiles(simd, 4),
            other => self.tiles(simd, other),
        }
    }
}

impl Attend<'_> {
    #[inline(always)]
    fn tiles<S: Simd>(self, simd: S, vectors: usize) {
        let Self { columns, envs, rings, layer, layers, history, qkv, turns, out, scratch } = self;
        let Columns { width, heads, d, .. } = *columns;
        let (tile, scale) = (vectors * S::F32_LANES, simd.splat_f32s((d as f32).powf(-0.5)));
        // As many columns as hold every head once, and after how many they come again.
        let (few, period) = match S::F32_LANES {
            lanes if heads <= lanes => (lanes, lanes / heads * heads),
            _ => (tile, tile),
        };
        scratch.resize(2 * history * tile + (history + 1) * (few + tile) + few, 0.0);
        let (sums, rest) = scratch.split_at_mut(2 * history * tile);
        let (scores, shares) = rest.split_at_mut((history + 1) * few);
        let rows = qkv.chunks_exact_mut(3 * width).zip(turns.chunks_exact(width)).zip(out.chunks_exact_mut(width));
        for ((env, before), ((row, turns), out)) in envs.zip(rows) {
            let ring = &mut rings[(env * layers + layer) * 2 * history * width..][..2 * history * width];
            let (keys, values) = ring.split_at_mut(history * width);
            let (newest, seen) = (before % history * width, (before + 1).min(history));
            let (q, kv) = row.split_at_mut(width);
            let (k, v) = kv.split_at_mut(width);
            turn(q, turns);
            turn(k, turns);
            keys[newest..][..width].copy_from_slice(k);
            values[newest..][..width].copy_from_slice(v);
            // Products, twice in a row: from any column on, the next ones hold every head.
            for (sums, key) in sums.chunks_exact_mut(2 * tile).zip(keys.chunks_exact(width)).take(seen) {
                let mut sum = [simd.splat_f32s(0.0); MOST];
                let sum = &mut sum[..vectors];
                for (q, k) in of::<S>(q).chunks_exact(vectors).zip(of::<S>(key).chunks_exact(vectors)) {
                    (0..vectors).for_each(|i| sum[i] = simd.mul_add_f32s(q[i], k[i], sum[i]));
                }
                let (sums, _) = S::as_mut_simd_f32s(sums);
                sums[..vectors].copy_from_slice(sum);
                sums[vectors..].copy_from_slice(sum);
            }
            // Scores, in each of a few columns those of its head.
            let (scores, rest) = scores.split_at_mut(seen * few);
            let mut most = [simd.splat_f32s(f32::NEG_INFINITY); MOST];
            for (score, sums) in scores.chunks_exact_mut(few).zip(sums.chunks_exact(2 * tile)) {
                let (score, _) = S::as_mut_simd_f32s(score);
                for (i, score) in score.iter_mut().enumerate() {
                    let mut sum = simd.splat_f32s(0.0);
                    for from in (0..tile).step_by(heads) {
                        sum = simd.add_f32s(sum, of::<S>(&sums[from + i * S::F32_LANES..][..S::F32_LANES])[0]);
                    }
                    *score = simd.mul_f32s(sum, scale);
                    most[i] = simd.max_f32s(most[i], *score);
                }
            }
            for score in scores.chunks_exact_mut(few) {
                let (score, _) = S::as_mut_simd_f32s(score);
                score.iter_mut().zip(&most).for_each(|(s, m)| *s = simd.sub_f32s(*s, *m));
            }
            scores.iter_mut().for_each(|s| *s = exp(*s));
            let (total, _) = S::as_mut_simd_f32s(&mut rest[..few]);
            total.fill(simd.splat_f32s(0.0));
            for score in scores.chunks_exact(few) {
                of::<S>(score).iter().zip(&mut *total).for_each(|(s, t)| *t = simd.add_f32s(*t, *s));
            }
            // Shares and their total, over the whole tile; what goes beyond it the next one writes over.
            for (slot, score) in scores.chunks_exact(few).chain([&rest[..few]]).enumerate() {
                for at in (0..tile).step_by(period) {
                    let (share, _) = S::as_mut_simd_f32s(&mut shares[slot * tile + at..][..few]);
                    share.iter_mut().zip(of::<S>(score)).for_each(|(s, x)| *s = *x);
                }
            }
            let (shares, total) = shares.split_at(seen * tile);
            let total = &of::<S>(total)[..vectors];
            let (out, _) = S::as_mut_simd_f32s(out);
            for (at, out) in out.chunks_exact_mut(vectors).enumerate() {
                let mut sum = [simd.splat_f32s(0.0); MOST];
                for (share, value) in shares.chunks_exact(tile).zip(values.chunks_exact(width)) {
                    let (share, value) = (of::<S>(share), &of::<S>(value)[at * vectors..][..vectors]);
                    (0..vectors).for_each(|i| sum[i] = simd.mul_add_f32s(share[i], value[i], sum[i]));
                }
                (0..vectors).for_each(|i| out[i] = simd.div_f32s(sum[i], total[i]));
            }
        }
    }
}

/// Floats as vectors.
#[inline(always)]
fn of<S: Simd>(x: &[f32]) -> &[S::f32s] {
    S::as_simd_f32s(x).0
}

/// Turns columns m and m + d/2 of every head together; `turns` are their cosines, then their sines.
#[inline(always)]
fn turn(x: &mut [f32], turns: &[f32]) {
    let half = x.len() / 2;
    let ((a, b), (cos, sin)) = (x.split_at_mut(half), turns.split_at(half));
    for ((a, b), (cos, sin)) in a.iter_mut().zip(b).zip(cos.iter().zip(sin)) {
        (*a, *b) = (*a * cos - *b * sin, *a * sin + *b * cos);
    }
}
