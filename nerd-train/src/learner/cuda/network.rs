//! Forward and backward pass over `rows` windows, as kernels and matrix products on preallocated memory.
//!
//! Row-major `y = x W` with `x [n, i]`, `W [i, o]` is column-major `y^T = W^T x^T`, so cuBLAS sees every matrix
//! transposed. Forward per block, with LN the plain normalisation (weights folded, see `layout`):
//! `x += Attn(LN(x) W_qkv') W_proj`, `x += gelu(LN(x) W_up') W_down`. Backward keeps the residual gradient in two
//! buffers turn about, so that weight gradients run on the side stream while the main stream goes on.

use nerd_cuda::Event;

use super::Precision;
use super::layout::Layout;
use crate::learner::LearnError;
use nerd_cuda::Arg::{Float, Int, Ptr};
use nerd_cuda::{Buffer, Device, DeviceError, Lane, Op};

/// Every kernel of `kernels.cu`.
const KERNELS: [&str; 23] = [
    "gather",
    "select_rows",
    "fold",
    "unfold",
    "norm_forward",
    "norm_backward",
    "attention_forward",
    "attention_backward",
    "attention_stream",
    "gelu_forward",
    "gelu_backward",
    "head_predict",
    "head_loss",
    "column_sum",
    "position_partial",
    "add_loss",
    "square_partial",
    "finish",
    "adam",
    "muon_pack",
    "muon_unit",
    "muon_polynomial",
    "muon_apply",
];

/// Rows of partial sums of the head and of the position table.
const HEAD_ROWS: usize = 264;
const POSITION_ROWS: usize = 64;

/// What the backward pass needs of one block, `[tokens][..]`.
struct Kept {
    norm_attn: Buffer<f32>,
    qkv: Buffer<f32>,
    attended: Buffer<f32>,
    norm_mlp: Buffer<f32>,
    up: Buffer<f32>,
    active: Buffer<f32>,
    rstd: [Buffer<f32>; 2],
}

/// Memory of the backward pass.
struct Backward {
    /// Residual gradient, turn about.
    dx: [Buffer<f32>; 2],
    narrow: Buffer<f32>,
    wide: Buffer<f32>,
    dqkv: Buffer<f32>,
    positions: Buffer<f32>,
    /// Main stream's progress, and the side stream's per half block.
    fork: Event,
    mlp: Event,
    attention: Event,
}

/// A network shape on a device, with memory for `rows` windows.
pub(super) struct Network {
    pub device: Device,
    pub layout: Layout,
    pub rows: usize,
    /// Gathered inputs `[rows][T][padded]` and targets `[rows][T][outputs]`.
    pub inputs: Buffer<f32>,
    pub targets: Buffer<f32>,
    folded: Buffer<f32>,
    table: Buffer<[i32; 4]>,
    /// Of rotary positions.
    turns: Buffer<[f32; 2]>,
    pub x: Buffer<f32>,
    kept: Vec<Kept>,
    norm: Buffer<f32>,
    rstd: Buffer<f32>,
    mapped: Buffer<f32>,
    z: Buffer<f32>,
    head: Buffer<f32>,
    backward: Option<Backward>,
}

impl Network {
    /// Memory for `rows` windows on a GPU; `train` adds what the backward pass needs.
    pub fn new(ordinal: usize, layout: Layout, rows: usize, precision: Precision, train: bool) -> Result<Self, LearnError> {
        let c = layout.config;
        // Kernels and products count rows, and launches their blocks, in 31 bits.
        let most = i32::MAX as usize / (layout.tokens * c.heads * 32);
        if !(1..=most).contains(&rows) {
            return Err(LearnError::Mismatch(format!("{rows} rows at once: 1 to {most} fit the CUDA engine")));
        }
        let device = Device::open(ordinal, &layout.source(), &KERNELS)?.with_products(precision)?;
        let (n, e) = (rows * layout.tokens, c.embedding);
        let zeros = |len| device.zeros::<f32>(len);
        let kept = |_| -> Result<Kept, LearnError> {
            Ok(Kept {
                norm_attn: zeros(n * e)?,
                qkv: zeros(3 * n * e)?,
                attended: zeros(n * e)?,
                norm_mlp: zeros(n * e)?,
                up: zeros(4 * n * e)?,
                active: zeros(4 * n * e)?,
                rstd: [zeros(n)?, zeros(n)?],
            })
        };
        // Without a backward pass all blocks use the same memory.
        let kept = (0..if train { c.layers } else { 1 }).map(kept).collect::<Result<_, _>>()?;
        let backward = || -> Result<Backward, LearnError> {
            Ok(Backward {
                dx: [zeros(n * e)?, zeros(n * e)?],
                narrow: zeros(n * e)?,
                wide: zeros(4 * n * e)?,
                dqkv: zeros(3 * n * e)?,
                positions: zeros(POSITION_ROWS * layout.tokens * e)?,
                fork: device.event()?,
                mlp: device.event()?,
                attention: device.event()?,
            })
        };
        let backward = if train { Some(backward()?) } else { None };
        Ok(Self {
            inputs: zeros(n * layout.padded)?,
            targets: zeros(n * c.outputs)?,
            folded: zeros(layout.folded)?,
            table: device.upload(&layout.table)?,
            turns: device.upload(&layout.turns(layout.tokens))?,
            x: zeros(n * e)?,
            kept,
            norm: zeros(n * e)?,
            rstd: zeros(n)?,
            mapped: zeros(n * e)?,
            z: zeros(n * c.head)?,
            head: zeros(HEAD_ROWS * layout.head_columns())?,
            backward,
            rows,
            layout,
            device,
        })
    }

    /// Folds the LayerNorm weights of the parameters at `w` into the matrices behind them.
    pub fn fold(&self, w: u64) -> Result<(), DeviceError> {
        let args = [Ptr(w), Ptr(self.folded.ptr), Ptr(self.table.ptr)];
        self.device.launch("fold", (self.layout.config.embedding, self.layout.table.len()), (256, 1), 0, &args)
    }

    /// Inputs of `n` tokens to the residual stream behind the last block. `attend` is told the block, `qkv` and where
    /// the mixed values go.
    pub fn trunk(&self, w: u64, n: usize, attend: impl Fn(usize, u64, u64) -> Result<(), DeviceError>) -> Result<(), DeviceError> {
        let l = &self.layout;
        let e = l.config.embedding;
        self.linear((self.inputs.ptr, l.padded), l.at(w, l.embed), self.x.ptr, (n, l.config.inputs, e), 0.0)?;
        for (i, b) in l.blocks.iter().enumerate() {
            let k = &self.kept[i.min(self.kept.len() - 1)];
            let (bias, position) = if i == 0 { (l.at(w, l.embed_bias), l.position.map_or(0, |p| l.at(w, p))) } else { (0, 0) };
            self.normalise(self.x.ptr, bias, position, &k.norm_attn, &k.rstd[0], n)?;
            self.linear((k.norm_attn.ptr, e), self.folded.at(b.qkv.folded), k.qkv.ptr, (n, e, 3 * e), 0.0)?;
            attend(i, k.qkv.ptr, k.attended.ptr)?;
            self.linear((k.attended.ptr, e), l.at(w, b.proj), self.x.ptr, (n, e, e), 1.0)?;
            self.normalise(self.x.ptr, 0, 0, &k.norm_mlp, &k.rstd[1], n)?;
            self.linear((k.norm_mlp.ptr, e), self.folded.at(b.up.folded), k.up.ptr, (n, e, 4 * e), 0.0)?;
            self.device.launch("gelu_forward", ((n * e).div_ceil(256), 1), (256, 1), 0, &[Ptr(k.up.ptr), Ptr(k.active.ptr), Int(n * e)])?;
            self.linear((k.active.ptr, 4 * e), l.at(w, b.down), self.x.ptr, (n, 4 * e, e), 1.0)?;
        }
        Ok(())
    }

    /// [`Network::trunk`] of whole windows.
    pub fn windows(&self, w: u64, rows: usize) -> Result<(), DeviceError> {
        let l = &self.layout;
        let (threads, shared, _) = l.attention();
        let grid = (rows, l.config.heads / l.group);
        self.trunk(w, rows * l.tokens, |_, qkv, out| {
            self.device.launch("attention_forward", grid, (threads, 1), shared, &[Ptr(qkv), Ptr(out), Ptr(self.turns.ptr)])
        })
    }

    /// Final norm, map and first layer of the head of the `n` tokens at `x`; leaves `z` before its bias.
    pub fn top(&self, w: u64, x: u64, n: usize) -> Result<(), DeviceError> {
        let (l, e) = (&self.layout, self.layout.config.embedding);
        self.normalise(x, 0, 0, &self.norm, &self.rstd, n)?;
        self.linear((self.norm.ptr, e), self.folded.at(l.out.folded), self.mapped.ptr, (n, e, e), 0.0)?;
        self.linear((self.mapped.ptr, e), l.at(w, l.hidden), self.z.ptr, (n, e, l.config.head), 0.0)
    }

    /// Predictions of the `n` tokens last through [`Network::top`], to `out [n][outputs]`.
    pub fn predict(&self, w: u64, n: usize, out: u64) -> Result<(), DeviceError> {
        let l = &self.layout;
        let args = [Ptr(self.z.ptr), Ptr(l.at(w, l.hidden_bias)), Ptr(l.at(w, l.head_out)), Ptr(l.at(w, l.head_bias)), Ptr(out), Int(n)];
        self.device.launch("head_predict", (n.div_ceil(8), 1), (256, 1), 0, &args)
    }

    /// Squared error of the first `n` tokens against the targets, which are among `all` of a mean. `sums` gets the gradients of the head's biases
    /// and output matrix, then the squared error; `z` becomes its own gradient ([`crate::learner::LearnerConfig::huber`]).
    pub fn loss(&self, w: u64, n: usize, all: usize, huber: Option<f32>, sums: u64) -> Result<(), DeviceError> {
        let l = &self.layout;
        let blocks = n.div_ceil(8).min(HEAD_ROWS);
        let gain = 2.0 / (all * l.config.outputs) as f32;
        let weights = [Ptr(self.z.ptr), Ptr(l.at(w, l.hidden_bias)), Ptr(l.at(w, l.head_out)), Ptr(l.at(w, l.head_bias))];
        let rest = [Ptr(self.targets.ptr), Ptr(self.head.ptr), Int(n), Float(gain), Float(huber.map_or(0.0, |d| (d * d).recip()))];
        self.device.launch("head_loss", (blocks, 1), (256, 1), 0, &[&weights[..], &rest[..]].concat())?;
        self.column_sum(self.head.ptr, blocks, l.head_columns(), sums)
    }

    /// What all windows add to the gradient of the mean loss of `batch` of them, with respect to the parameters at `w`, to `g`; behind
    /// its end the squared error. Needs [`Network::trunk`] and [`Network::top`] before it.
    pub fn backward(&self, w: u64, batch: usize, huber: Option<f32>, g: u64) -> Result<(), DeviceError> {
        let Some(m) = &self.backward else { return Err(DeviceError("the network was built without a backward pass".into())) };
        let (l, d) = (&self.layout, &self.device);
        let (e, n, hidden) = (l.config.embedding, self.rows * l.tokens, l.config.head);
        let (threads, _, shared) = l.attention();
        self.loss(w, n, batch * l.tokens, huber, l.at(g, l.hidden_bias))?;

        // Head and final norm. `dqkv` serves as scratch for the gradient of `mapped`.
        self.linear_dx(self.z.ptr, l.at(w, l.hidden), m.dqkv.ptr, (n, e, hidden))?;
        self.fork(m)?;
        self.linear_dw((self.mapped.ptr, e), self.z.ptr, l.at(g, l.hidden), (n, e, hidden))?;
        self.linear_dw((self.norm.ptr, e), m.dqkv.ptr, l.at(g, l.out.plain), (n, e, e))?;
        d.mark(Lane::Side, &m.mlp)?;
        d.mark(Lane::Side, &m.attention)?;
        self.linear_dx(m.dqkv.ptr, self.folded.at(l.out.folded), m.narrow.ptr, (n, e, e))?;
        self.normalise_back(m, &self.norm, &self.rstd, None, &m.dx[0], n)?;

        for (b, k) in l.blocks.iter().zip(&self.kept).rev() {
            // MLP: dx[0] in, dx[1] out.
            d.after(Lane::Main, &m.mlp)?;
            self.linear_dx(m.dx[0].ptr, l.at(w, b.down), m.wide.ptr, (n, 4 * e, e))?;
            d.launch("gelu_backward", ((n * e).div_ceil(256), 1), (256, 1), 0, &[Ptr(k.up.ptr), Ptr(m.wide.ptr), Int(n * e)])?;
            self.fork(m)?;
            self.linear_dw((k.active.ptr, 4 * e), m.dx[0].ptr, l.at(g, b.down), (n, 4 * e, e))?;
            self.linear_dw((k.norm_mlp.ptr, e), m.wide.ptr, l.at(g, b.up.plain), (n, e, 4 * e))?;
            d.mark(Lane::Side, &m.mlp)?;
            self.linear_dx(m.wide.ptr, self.folded.at(b.up.folded), m.narrow.ptr, (n, e, 4 * e))?;
            d.after(Lane::Main, &m.attention)?;
            self.normalise_back(m, &k.norm_mlp, &k.rstd[1], Some(&m.dx[0]), &m.dx[1], n)?;

            // Attention: dx[1] in, dx[0] out.
            self.linear_dx(m.dx[1].ptr, l.at(w, b.proj), m.narrow.ptr, (n, e, e))?;
            let args = [Ptr(k.qkv.ptr), Ptr(m.narrow.ptr), Ptr(m.dqkv.ptr), Ptr(self.turns.ptr)];
            d.launch("attention_backward", (self.rows, l.config.heads / l.group), (threads, 1), shared, &args)?;
            self.fork(m)?;
            self.linear_dw((k.attended.ptr, e), m.dx[1].ptr, l.at(g, b.proj), (n, e, e))?;
            self.linear_dw((k.norm_attn.ptr, e), m.dqkv.ptr, l.at(g, b.qkv.plain), (n, e, 3 * e))?;
            d.mark(Lane::Side, &m.attention)?;
            self.linear_dx(m.dqkv.ptr, self.folded.at(b.qkv.folded), m.narrow.ptr, (n, e, 3 * e))?;
            d.after(Lane::Main, &m.mlp)?;
            self.normalise_back(m, &k.norm_attn, &k.rstd[0], Some(&m.dx[1]), &m.dx[0], n)?;
        }

        // Embedding: the bias gradient is the sum of the gradients by place, which are those of a position table.
        self.fork(m)?;
        self.linear_dw((self.inputs.ptr, l.padded), m.dx[0].ptr, l.at(g, l.embed), (n, l.config.inputs, e))?;
        d.mark(Lane::Side, &m.attention)?;
        let (chunks, width) = (self.rows.min(POSITION_ROWS), l.tokens * e);
        d.launch(
            "position_partial",
            (width.div_ceil(128), chunks),
            (128, 1),
            0,
            &[Ptr(m.dx[0].ptr), Int(self.rows), Ptr(m.positions.ptr)],
        )?;
        let places = l.position.map_or(m.narrow.ptr, |p| l.at(g, p));
        self.column_sum(m.positions.ptr, chunks, width, places)?;
        self.column_sum(places, l.tokens, e, l.at(g, l.embed_bias))?;
        d.after(Lane::Main, &m.attention)?;
        d.launch("unfold", (e, l.table.len()), (128, 1), 0, &[Ptr(w), Ptr(g), Ptr(self.table.ptr)])
    }

    /// The side stream goes on after what the main stream has been given.
    fn fork(&self, m: &Backward) -> Result<(), DeviceError> {
        self.device.mark(Lane::Main, &m.fork)?;
        self.device.after(Lane::Side, &m.fork)
    }

    fn normalise(&self, x: u64, bias: u64, position: u64, out: &Buffer<f32>, rstd: &Buffer<f32>, n: usize) -> Result<(), DeviceError> {
        self.device.launch(
            "norm_forward",
            (n.div_ceil(8), 1),
            (256, 1),
            0,
            &[Ptr(x), Ptr(bias), Ptr(position), Ptr(out.ptr), Ptr(rstd.ptr), Int(n)],
        )
    }

    /// `to = from + dLN(narrow)`.
    fn normalise_back(
        &self,
        m: &Backward,
        norm: &Buffer<f32>,
        rstd: &Buffer<f32>,
        from: Option<&Buffer<f32>>,
        to: &Buffer<f32>,
        n: usize,
    ) -> Result<(), DeviceError> {
        let args = [Ptr(m.narrow.ptr), Ptr(norm.ptr), Ptr(rstd.ptr), Ptr(from.map_or(0, |b| b.ptr)), Ptr(to.ptr), Int(n)];
        self.device.launch("norm_backward", (n.div_ceil(8), 1), (256, 1), 0, &args)
    }

    fn column_sum(&self, src: u64, rows: usize, width: usize, out: u64) -> Result<(), DeviceError> {
        self.device.launch("column_sum", (width.div_ceil(32), 1), (32, 8), 0, &[Ptr(src), Int(rows), Int(width), Ptr(out)])
    }

    /// `y = x W + beta y`, `x [n, i]` with rows `ld` apart, `W [i, o]`.
    fn linear(&self, (x, ld): (u64, usize), w: u64, y: u64, (n, i, o): (usize, usize, usize), beta: f32) -> Result<(), DeviceError> {
        self.device.product(Lane::Main, (Op::Plain, Op::Plain), (o, n, i), (w, o), (x, ld), beta, (y, o))
    }

    /// `dx = dy W^T`.
    fn linear_dx(&self, dy: u64, w: u64, dx: u64, (n, i, o): (usize, usize, usize)) -> Result<(), DeviceError> {
        self.device.product(Lane::Main, (Op::Transposed, Op::Plain), (i, n, o), (w, o), (dy, o), 0.0, (dx, i))
    }

    /// `dW = x^T dy`, on the side stream.
    fn linear_dw(&self, (x, ld): (u64, usize), dy: u64, dw: u64, (n, i, o): (usize, usize, usize)) -> Result<(), DeviceError> {
        self.device.product(Lane::Side, (Op::Plain, Op::Transposed), (o, i, n), (dy, o), (x, ld), 0.0, (dw, o))
    }
}

impl Layout {
    /// Address of entry `offset` of the flat vector at `base`.
    fn at(&self, base: u64, offset: usize) -> u64 {
        base + 4 * offset as u64
    }
}
