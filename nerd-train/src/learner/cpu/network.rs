//! Forward and backward pass over the windows of a shard.
//!
//! A layer norm's weight is folded into the matrix behind it, `W' = diag(w) W`, once an update; then `dW = diag(w) dW'` and
//! `dw_i = sum_j dW'_ij W_ij`.

use faer::Accum::{Add, Replace};
use faer::MatRef;
use nalgebra::DMatrix;
use nerd_model::transformer::TransformerConfig;

use super::attention::Attention;
use super::elementwise::{gelu, multiply, normalize, normalize_back, relu, relu_back, sum_rows};
use super::parts::{Block, Parts};
use crate::learner::sharded::Shard;
use crate::product::{matrix, product};

/// A network with memory for a pass.
pub struct Network {
    config: TransformerConfig,
    flat: Vec<f32>,
    /// `W'`, in the order of [`Parts::normed`].
    folded: Vec<Vec<f32>>,
    attention: Attention,
    tape: Tape,
}

/// What the backward pass needs of one block, a row for each token.
#[derive(Default)]
struct Kept {
    norm_attn: Norm,
    qkv: Vec<f32>,
    shares: Vec<f32>,
    attended: Vec<f32>,
    norm_mlp: Norm,
    slope: Vec<f32>,
    active: Vec<f32>,
}

/// Normalised rows, and the inverse of what they were divided by.
#[derive(Default)]
struct Norm {
    out: Vec<f32>,
    inverse: Vec<f32>,
}

#[derive(Default)]
struct Tape {
    x: Vec<f32>,
    blocks: Vec<Kept>,
    norm: Norm,
    mapped: Vec<f32>,
    hidden: Vec<f32>,
    error: Vec<f32>,
    narrow: Vec<f32>,
    wide: Vec<f32>,
}

impl Network {
    pub fn new(config: TransformerConfig) -> Self {
        let tape = Tape { blocks: (0..config.layers).map(|_| Kept::default()).collect(), ..Tape::default() };
        Self { config, flat: Vec::new(), folded: vec![Vec::new(); 2 * config.layers + 1], attention: Attention::new(&config), tape }
    }

    /// Takes these weights.
    pub fn load(&mut self, flat: &[f32]) {
        self.flat.clear();
        self.flat.extend_from_slice(flat);
        for ((norm, matrix), folded) in Parts::of(&self.config, &self.flat).normed().zip(&mut self.folded) {
            folded.clear();
            let rows = matrix.chunks_exact(matrix.len() / norm.len());
            rows.zip(norm).for_each(|(row, w)| folded.extend(row.iter().map(|x| x * w)));
        }
    }

    /// Predictions minus targets, `[windows][tokens][outputs]`.
    pub fn forward(&mut self, shard: &Shard) -> &mut [f32] {
        let Self { config: c, flat, folded, attention, tape: t } = self;
        let (e, n, w) = (c.embedding, shard.windows * shard.tokens, Parts::of(c, flat));
        set(&mut t.x, matrix(&shard.x, n, c.inputs), matrix(w.embed, c.inputs, e));
        for (i, row) in t.x.chunks_exact_mut(e).enumerate() {
            let place = w.position.map(|p| &p[i % shard.tokens * e..][..e]);
            row.iter_mut().zip(w.embed_bias).for_each(|(x, b)| *x += b);
            row.iter_mut().zip(place.unwrap_or_default()).for_each(|(x, p)| *x += p);
        }
        for ((b, k), f) in w.blocks.iter().zip(&mut t.blocks).zip(folded.chunks_exact(2)) {
            k.norm_attn.forward(&t.x, e);
            set(&mut k.qkv, k.norm_attn.rows(), matrix(&f[0], e, 3 * e));
            attention.forward(&mut k.qkv, &mut k.shares, &mut k.attended);
            product(&mut t.x, Add, matrix(&k.attended, n, e), matrix(b.proj, e, e));
            k.norm_mlp.forward(&t.x, e);
            set(&mut k.slope, k.norm_mlp.rows(), matrix(&f[1], e, 4 * e));
            gelu(&mut k.slope, &mut k.active);
            product(&mut t.x, Add, matrix(&k.active, n, 4 * e), matrix(b.down, 4 * e, e));
        }
        t.norm.forward(&t.x, e);
        set(&mut t.mapped, t.norm.rows(), matrix(&folded[2 * c.layers], e, e));
        set(&mut t.hidden, matrix(&t.mapped, n, e), matrix(w.hidden, e, c.head));
        relu(&mut t.hidden, w.hidden_bias);
        set(&mut t.error, matrix(&t.hidden, n, c.head), matrix(w.head, c.head, c.outputs));
        for (row, y) in t.error.chunks_exact_mut(c.outputs).zip(shard.y.chunks_exact(c.outputs)) {
            row.iter_mut().zip(w.head_bias).zip(y).for_each(|((x, b), y)| *x += b - y);
        }
        &mut t.error
    }

    /// The inputs of every hidden matrix in the last forward pass, a row for each token.
    pub fn hidden_inputs(&self) -> Vec<DMatrix<f64>> {
        let (e, t, w) = (self.config.embedding, &self.tape, Parts::of(&self.config, &self.flat));
        let tokens = t.x.len() / e;
        let plain = |x: &[f32]| DMatrix::from_row_iterator(tokens, x.len() / tokens, x.iter().map(|x| f64::from(*x)));
        let normed = |x: &[f32], norm: &[f32]| {
            let mut x = plain(x);
            x.column_iter_mut().zip(norm).for_each(|(mut column, w)| column *= f64::from(*w));
            x
        };
        let of = |(b, k): (&Block<&[f32]>, &Kept)| {
            let (attn, mlp) = (normed(&k.norm_attn.out, b.norm_attn), normed(&k.norm_mlp.out, b.norm_mlp));
            [attn, plain(&k.attended), mlp, plain(&k.active)]
        };
        w.blocks.iter().zip(&t.blocks).flat_map(of).collect()
    }

    /// Gradient by the parameters from that by the predictions, which stands where [`Network::forward`] left the errors.
    pub fn backward(&mut self, shard: &Shard) -> Vec<f32> {
        let Self { config: c, flat, folded, attention, tape: t } = self;
        let (e, n, w) = (c.embedding, shard.windows * shard.tokens, Parts::of(c, flat));
        let mut gradient = vec![0.0; flat.len()];
        let mut g = Parts::of_mut(c, &mut gradient);

        let behind = matrix(&t.error, n, c.outputs);
        product(g.head, Replace, matrix(&t.hidden, n, c.head).transpose(), behind);
        sum_rows(&t.error, g.head_bias);
        set(&mut t.wide, behind, matrix(w.head, c.head, c.outputs).transpose());
        relu_back(&mut t.wide, &t.hidden);
        let behind = matrix(&t.wide, n, c.head);
        product(g.hidden, Replace, matrix(&t.mapped, n, e).transpose(), behind);
        sum_rows(&t.wide, g.hidden_bias);
        set(&mut t.narrow, behind, matrix(w.hidden, e, c.head).transpose());
        let behind = matrix(&t.narrow, n, e);
        product(g.out, Replace, t.norm.rows().transpose(), behind);
        set(&mut t.wide, behind, matrix(&folded[2 * c.layers], e, e).transpose());
        // The residual stream's gradient takes the stream's place.
        t.x.fill(0.0);
        t.norm.backward(&mut t.wide, &mut t.x);

        let blocks = w.blocks.iter().zip(&mut g.blocks).zip(&t.blocks).zip(folded.chunks_exact(2));
        for (((b, g), k), f) in blocks.rev() {
            let behind = matrix(&t.x, n, e);
            product(g.down, Replace, matrix(&k.active, n, 4 * e).transpose(), behind);
            set(&mut t.wide, behind, matrix(b.down, 4 * e, e).transpose());
            multiply(&mut t.wide, &k.slope);
            let behind = matrix(&t.wide, n, 4 * e);
            product(g.up, Replace, k.norm_mlp.rows().transpose(), behind);
            set(&mut t.narrow, behind, matrix(&f[1], e, 4 * e).transpose());
            k.norm_mlp.backward(&mut t.narrow, &mut t.x);

            let behind = matrix(&t.x, n, e);
            product(g.proj, Replace, matrix(&k.attended, n, e).transpose(), behind);
            set(&mut t.narrow, behind, matrix(b.proj, e, e).transpose());
            attention.backward(&k.qkv, &k.shares, &t.narrow, &mut t.wide);
            let behind = matrix(&t.wide, n, 3 * e);
            product(g.qkv, Replace, k.norm_attn.rows().transpose(), behind);
            set(&mut t.narrow, behind, matrix(&f[0], e, 3 * e).transpose());
            k.norm_attn.backward(&mut t.narrow, &mut t.x);
        }

        product(g.embed, Replace, matrix(&shard.x, n, c.inputs).transpose(), matrix(&t.x, n, e));
        sum_rows(&t.x, g.embed_bias);
        if let Some(places) = g.position.as_mut() {
            sum_rows(&t.x, &mut places[..shard.tokens * e]);
        }
        for ((d_norm, d_matrix), (norm, matrix)) in g.normed().zip(w.normed()) {
            let width = matrix.len() / norm.len();
            let rows = d_matrix.chunks_exact_mut(width).zip(matrix.chunks_exact(width));
            for ((d, w), (d_row, row)) in d_norm.iter_mut().zip(norm).zip(rows) {
                *d = d_row.iter().zip(row).map(|(d, x)| d * x).sum();
                d_row.iter_mut().for_each(|d| *d *= w);
            }
        }
        gradient
    }
}

impl Norm {
    fn forward(&mut self, x: &[f32], e: usize) {
        normalize(x, e, &mut self.out, &mut self.inverse);
    }

    fn backward(&self, behind: &mut [f32], dx: &mut [f32]) {
        normalize_back(behind, &self.out, &self.inverse, dx);
    }

    fn rows(&self) -> MatRef<'_, f32> {
        matrix(&self.out, self.inverse.len(), self.out.len() / self.inverse.len())
    }
}

/// `out = a b`.
fn set(out: &mut Vec<f32>, a: MatRef<'_, f32>, b: MatRef<'_, f32>) {
    out.resize(a.nrows() * b.ncols(), 0.0);
    product(out, Replace, a, b);
}
