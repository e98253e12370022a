//! Matrix products (GEMM) with a matrix packed once at loading, into panels as wide as the processor's registers.
//!
//! A general GEMM packs its operands at every call, which costs more than the product for a frame's few rows. Here a
//! panel stays in the L1 cache for all rows, and a tile of sums in registers.

use pulp::{Arch, Simd, WithSimd};

/// A packed matrix `W`, `[inner, outer]`.
#[derive(Default)]
pub struct Matrix {
    inner: usize,
    outer: usize,
    /// SIMD vectors per row of a panel.
    vectors: usize,
    /// `[panel][inner][vectors * lanes]`, zero beyond the last column.
    panels: Vec<f32>,
}

impl Matrix {
    /// Packs a row-major `[inner, outer]` matrix.
    pub fn new(inner: usize, values: &[f32]) -> Self {
        let mut matrix = Self::default();
        matrix.cut(inner, values);
        matrix
    }

    /// As `Self::new`, reusing this matrix's memory.
    pub fn cut(&mut self, inner: usize, values: &[f32]) {
        let outer = values.len() / inner;
        let lanes = Arch::new().dispatch(Lanes);
        // Least padding columns first; among equals, fewest loads per sum with registers to spare.
        let shapes = if lanes >= 16 { [3, 4, 2] } else { [2, 3, 4] };
        let wide = shapes.into_iter().min_by_key(|v| outer.next_multiple_of(v * lanes)).unwrap_or(3);
        let vectors = if outer > lanes { wide } else { 1 };
        let width = vectors * lanes;
        let mut panels = std::mem::take(&mut self.panels);
        panels.clear();
        panels.reserve(inner * outer.next_multiple_of(width));
        if outer == width {
            panels.extend_from_slice(values);
        } else {
            for first in (0..outer).step_by(width) {
                for row in values.chunks_exact(outer) {
                    let row = &row[first..outer.min(first + width)];
                    panels.extend_from_slice(row);
                    panels.resize(panels.len() + width - row.len(), 0.0);
                }
            }
        }
        *self = Self { inner, outer, vectors, panels };
    }

    /// Packs the transpose of a row-major `[outer, inner]` matrix.
    pub fn of_transpose(inner: usize, values: &[f32]) -> Self {
        let outer = values.len() / inner;
        let turned: Vec<f32> = (0..inner).flat_map(|k| (0..outer).map(move |row| values[row * inner + k])).collect();
        Self::new(inner, &turned)
    }

    /// `out = x W`, plus the bias if any, for rows `x` `[rows, inner]`.
    pub fn product(&self, x: &[f32], bias: Option<&[f32]>, out: &mut Vec<f32>) {
        out.resize(x.len() / self.inner * self.outer, 0.0);
        Arch::new().dispatch(Product { matrix: self, x, out, add: false, bias, across: false });
    }

    /// `out += x W` for rows `x` `[rows, inner]`.
    pub fn add_product(&self, x: &[f32], out: &mut [f32]) {
        Arch::new().dispatch(Product { matrix: self, x, out, add: true, bias: None, across: false });
    }

    /// `out = x^T W` for `x` `[inner, rows]`.
    pub fn across(&self, x: &[f32], out: &mut [f32]) {
        Arch::new().dispatch(Product { matrix: self, x, out, add: false, bias: None, across: true });
    }
}

struct Lanes;

impl WithSimd for Lanes {
    type Output = usize;

    #[inline(always)]
    fn with_simd<S: Simd>(self, _: S) -> usize {
        S::F32_LANES
    }
}

/// `x W`, or `x^T W` with `across`.
struct Product<'a> {
    matrix: &'a Matrix,
    x: &'a [f32],
    out: &'a mut [f32],
    add: bool,
    bias: Option<&'a [f32]>,
    across: bool,
}

impl WithSimd for Product<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        // Tile sizes R x V that leave registers for a row of the panel and an entry of x.
        match (S::F32_LANES, self.matrix.vectors) {
            (_, 1) => self.panels::<S, 12, 1>(simd),
            (16.., 2) => self.panels::<S, 12, 2>(simd),
            (16.., 4) => self.panels::<S, 6, 4>(simd),
            (16.., _) => self.panels::<S, 8, 3>(simd),
            (_, 2) => self.panels::<S, 6, 2>(simd),
            (_, 4) => self.panels::<S, 2, 4>(simd),
            _ => self.panels::<S, 3, 3>(simd),
        }
    }
}

/// Rows of the inner dimension of `x^T` that stay in cache while all columns pass them.
const NEAR: usize = 48;

impl Product<'_> {
    #[inline(always)]
    fn panels<S: Simd, const R: usize, const V: usize>(self, simd: S) {
        let Self { matrix: Matrix { inner, outer, panels, .. }, x, out, add, bias, across } = self;
        let inner = *inner;
        let outer = *outer;
        let width = V * S::F32_LANES;
        let rows = x.len() / inner;
        let near = if across { NEAR } else { inner };
        let (vectors, _) = S::as_simd_f32s(panels);
        for (panel, first) in vectors.chunks_exact(inner * V).zip((0..outer).step_by(width)) {
            let columns = first..outer.min(first + width);
            let bias = bias.map(|bias| &bias[columns.clone()]);
            for (part, panel) in panel.as_chunks::<V>().0[..inner].chunks(near).enumerate() {
                let x = &x[part * near * rows..];
                let add = add || part > 0;
                let mut outs = out.chunks_exact_mut(R * outer);
                let mut row = 0;
                for out in &mut outs {
                    let sums = tile(simd, x, (rows, row, across), panel);
                    store::<S, R, V>(simd, sums, out, outer, columns.clone(), (add, bias));
                    row += R;
                }
                for out in outs.into_remainder().chunks_exact_mut(outer) {
                    let sums = tile(simd, x, (rows, row, across), panel);
                    store::<S, 1, V>(simd, sums, out, outer, columns.clone(), (add, bias));
                    row += 1;
                }
            }
        }
    }
}

/// Products of R rows of x, from `row` on, with one panel. For `x^T W`, these are R columns of x `[inner, rows]`.
#[inline(always)]
fn tile<S: Simd, const R: usize, const V: usize>(
    simd: S,
    x: &[f32],
    (rows, row, across): (usize, usize, bool),
    panel: &[[S::f32s; V]],
) -> [[S::f32s; V]; R] {
    let inner = panel.len();
    let mut sums = [[simd.splat_f32s(0.0); V]; R];
    if across {
        for (x, panel) in x.chunks_exact(rows).zip(panel) {
            let x = &x[row..][..R];
            add::<S, R, V>(simd, std::array::from_fn(|r| x[r]), panel, &mut sums);
        }
        return sums;
    }
    let rows: [&[f32]; R] = std::array::from_fn(|r| &x[(row + r) * inner..][..inner]);
    for k in 0..inner {
        add::<S, R, V>(simd, std::array::from_fn(|r| rows[r][k]), &panel[k], &mut sums);
    }
    sums
}

/// `sums += x panel`.
#[inline(always)]
fn add<S: Simd, const R: usize, const V: usize>(
    simd: S,
    x: [f32; R],
    panel: &[S::f32s; V],
    sums: &mut [[S::f32s; V]; R],
) {
    for r in 0..R {
        let x = simd.splat_f32s(x[r]);
        for v in 0..V {
            sums[r][v] = simd.mul_add_f32s(x, panel[v], sums[r][v]);
        }
    }
}

#[inline(always)]
fn store<S: Simd, const R: usize, const V: usize>(
    simd: S,
    sums: [[S::f32s; V]; R],
    out: &mut [f32],
    outer: usize,
    columns: std::ops::Range<usize>,
    (add, bias): (bool, Option<&[f32]>),
) {
    let bias = bias.map(S::as_simd_f32s);
    for (sums, out) in sums.iter().zip(out.chunks_exact_mut(outer)) {
        let (whole, rest) = S::as_mut_simd_f32s(&mut out[columns.clone()]);
        let last = sums.get(whole.len());
        for (v, (o, s)) in whole.iter_mut().zip(sums).enumerate() {
            *o = match bias {
                Some((bias, _)) => simd.add_f32s(bias[v], *s),
                None if add => simd.add_f32s(*o, *s),
                None => *s,
            };
        }
        if let Some(s) = last.filter(|_| !rest.is_empty()) {
            let old = match bias {
                Some((_, bias)) => simd.partial_load_f32s(bias),
                None if add => simd.partial_load_f32s(rest),
                None => simd.splat_f32s(0.0),
            };
            simd.partial_store_f32s(rest, simd.add_f32s(old, *s));
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn products_of_every_shape_are_those_of_the_definition() {
        let value = |i: usize| ((i * 2_654_435_761) % 1000) as f32 * 1e-3 - 0.5;
        for (rows, inner, outer) in [
            (1, 1, 1),
            (7, 5, 3),
            (8, 37, 48),
            (13, 30, 32),
            (25, 96, 18),
            (9, 192, 64),
            (17, 48, 100),
            (33, 64, 14),
            (2, 3, 577),
        ] {
            let (x, w): (Vec<_>, Vec<_>) =
                ((0..rows * inner).map(value).collect(), (0..inner * outer).map(|i| value(i + 7)).collect());
            let matrix = Matrix::new(inner, &w);
            let exact = |i: usize| {
                let (r, c) = (i / outer, i % outer);
                (0..inner).map(|k| f64::from(x[r * inner + k]) * f64::from(w[k * outer + c])).sum::<f64>()
            };
            let mut set = Vec::new();
            let mut added = vec![1.0; rows * outer];
            let mut biased = Vec::new();
            matrix.product(&x, None, &mut set);
            matrix.product(&x, Some(&vec![1.0; outer]), &mut biased);
            matrix.add_product(&x, &mut added);
            assert_eq!(set.len(), rows * outer);
            assert_eq!(biased, added, "[{rows}, {inner}] [{inner}, {outer}]: to a bias of one");
            let turned: Vec<f32> = (0..inner * rows).map(|i| x[i % rows * inner + i / rows]).collect();
            let mut across = vec![1.0; rows * outer];
            matrix.across(&turned, &mut across);
            let turned: Vec<f32> = (0..outer * inner).map(|i| w[i % inner * outer + i / inner]).collect();
            let mut other = Vec::new();
            Matrix::of_transpose(inner, &turned).product(&x, None, &mut other);
            let apart =
                across.iter().chain(&other).zip(set.iter().cycle()).map(|(a, b)| (a - b).abs()).fold(0.0, f32::max);
            assert!(apart < 1e-5, "[{rows}, {inner}] [{inner}, {outer}]: transposes, off by {apart:.1e}");
            for (i, (s, a)) in set.iter().zip(&added).enumerate() {
                let s = f64::from(*s) - exact(i);
                let a = f64::from(*a) - 1.0 - exact(i);
                assert!(
                    s.abs() < 1e-5 && a.abs() < 1e-5,
                    "[{rows}, {inner}] [{inner}, {outer}], entry {i}: off by {s:.1e}, added {a:.1e}"
                );
            }
        }
    }
}
