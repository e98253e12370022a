//! The backward pass of a program, over the values stored by the forward pass.
//!
//! For `y = x W'`, `W' = diag(w) W`: `dx = dy W'^T`, `dW' = x^T dy`, `dW = diag(w) dW'` and `dw_i = sum_j dW'_ij W_ij`.

use super::elementwise::{normalize_back, sum_rows};
use super::{Loaded, Matrix, Memory, activate, neighbours, taken};
use crate::program::{Op, Step, Weight};

impl Loaded {
    /// Transposes all matrices of the backward pass in advance, so that threads do not wait for each other.
    pub fn turn(&self) {
        (0..self.program.steps.len())
            .filter(|i| self.program.steps[*i].from != self.program.tokens())
            .for_each(|i| _ = self.turned(i));
    }

    /// `W'^T` of the product in step `i`, if that step is a product.
    fn turned(&self, i: usize) -> Option<&Matrix> {
        let Step { to, op, .. } = self.program.steps[i];
        let Op::Linear { weight, scale, .. } = op else { return None };
        let folded = if scale.is_some() { &self.folded[i][..] } else { self.tensor(weight) };
        Some(self.back[i].get_or_init(|| Matrix::of_transpose(self.program.width(to), folded)))
    }

    /// Gradients with respect to parameters (flat) and, if `by_tokens`, tokens, from `upstream` with respect to
    /// predictions. Needs a forward pass of [`super::Pass::Kept`] with the same `tokens`.
    pub fn backward(
        &self,
        tokens: usize,
        upstream: &[f32],
        memory: &mut Memory,
        by_tokens: bool,
    ) -> (Vec<f32>, Vec<f32>) {
        let mut gradient = vec![0.0; self.flat.len()];
        let of_tokens = self.way_back(tokens, upstream, memory, Some(&mut gradient), by_tokens);
        (gradient, of_tokens)
    }

    /// Gradient with respect to the tokens alone. Several calls may follow one forward pass.
    pub fn backward_to_tokens(&self, tokens: usize, upstream: &[f32], memory: &mut Memory) -> Vec<f32> {
        self.way_back(tokens, upstream, memory, None, true)
    }

    fn way_back(
        &self,
        tokens: usize,
        upstream: &[f32],
        memory: &mut Memory,
        mut gradient: Option<&mut [f32]>,
        by_tokens: bool,
    ) -> Vec<f32> {
        let mut by_value: Vec<Vec<f32>> = vec![Vec::new(); self.program.widths.len()];
        let mut last = taken(&mut memory.spare, upstream.len());
        last.clear();
        last.extend_from_slice(upstream);
        by_value[self.program.predictions().0] = last;
        for i in (0..self.program.steps.len()).rev() {
            self.back(i, tokens, &mut by_value, memory, gradient.as_deref_mut(), by_tokens);
        }
        let of_tokens = std::mem::take(&mut by_value[0]);
        memory.spare.extend(by_value.into_iter().filter(|s| s.capacity() > 0));
        of_tokens
    }

    fn back(
        &self,
        i: usize,
        tokens: usize,
        by_value: &mut [Vec<f32>],
        memory: &mut Memory,
        gradient: Option<&mut [f32]>,
        by_tokens: bool,
    ) {
        let Step { from, to, op } = self.program.steps[i];
        let Memory { values, aside, spare, attention, gradients: cut } = memory;
        let (x, y) = (&values[from.0], &values[to.0]);
        let mut dy = std::mem::take(&mut by_value[to.0]);
        let range = |w: Weight| self.starts[w.0]..self.starts[w.0 + 1];
        // A slot with two readers already has a gradient.
        let mut dx = std::mem::take(&mut by_value[from.0]);
        let first = dx.is_empty();
        let asked = from != self.program.tokens() || by_tokens;
        if asked && first && to != from && !matches!(op, Op::Activate(_)) {
            dx = taken(spare, dy.len() / self.program.width(to) * self.program.width(from));
        }
        match op {
            Op::Linear { weight, scale, bias, .. } => {
                match asked.then(|| self.turned(i)).flatten() {
                    Some(back) if first => back.product(&dy, None, &mut dx),
                    Some(back) => back.add_product(&dy, &mut dx),
                    None => {}
                }
                if let Some(gradient) = gradient {
                    let outer = self.program.width(to);
                    cut.cut(dy.len() / outer, &dy);
                    cut.across(x, &mut gradient[range(weight)]);
                    if let Some(bias) = bias {
                        sum_rows(&dy, &mut gradient[range(bias)]);
                    }
                    if let Some(scale) = scale {
                        let norms = self.unfold(weight, scale, &mut gradient[range(weight)], outer);
                        gradient[range(scale)].copy_from_slice(&norms);
                    }
                }
            }
            Op::Place(table) => {
                if let Some(gradient) = gradient {
                    sum_rows(&dy, &mut gradient[range(table)][..tokens * self.program.width(to)]);
                }
            }
            Op::Norm => {
                if first {
                    dx.clear();
                    dx.resize(dy.len(), 0.0);
                }
                normalize_back(&mut dy, y, &aside[i], &mut dx);
            }
            Op::Attend { heads, band } => {
                attention.shape(self.program.width(to), heads, tokens, band, &self.program.frequencies);
                attention.backward(x, &aside[i], &dy, &mut dx);
            }
            Op::Neighbours(apart) => neighbours::backward(&dy, self.program.width(from), tokens, apart, &mut dx),
            Op::Activate(f) => {
                std::mem::swap(&mut dx, &mut dy);
                activate::backward(f, x, y, &mut dx);
            }
            Op::Gate => activate::gate_back(x, self.program.width(from), &dy, &mut dx),
        }
        if to == from || matches!(op, Op::Linear { add: true, .. }) {
            by_value[to.0] = dy;
        } else if dy.capacity() > 0 {
            spare.push(dy);
        }
        if to != from {
            by_value[from.0] = dx;
        }
    }

    /// Turns the gradient of a matrix with a norm's scale folded in, `diag(s) W`, into that of W. Returns the gradient
    /// of s.
    fn unfold(&self, weight: Weight, scale: Weight, gradient: &mut [f32], outer: usize) -> Vec<f32> {
        let w = self.tensor(weight);
        let mut norms = vec![0.0; w.len() / outer];
        let rows = gradient.chunks_exact_mut(outer).zip(w.chunks_exact(outer));
        for ((d, s), (d_row, row)) in norms.iter_mut().zip(self.tensor(scale)).zip(rows) {
            *d = d_row.iter().zip(row).map(|(d, x)| d * x).sum();
            d_row.iter_mut().for_each(|d| *d *= s);
        }
        norms
    }
}
