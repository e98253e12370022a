//! Muon on the GPU (see [`crate::learner::muon`]): all matrices of one shape as one batch of products.
//!
//! `muon_pack` updates the momentum and packs its Nesterov step, `muon_unit` divides by the norm. Five times:
//! `A = X X^T`, `P = A A`, `P <- a 1 + b A + c P`, `X <- P X`. `muon_apply` updates weights and average. Shapes run
//! alternately on the main and the side stream.

use std::collections::BTreeSet;

use super::*;
use crate::learner::muon::{COEFFICIENTS, ITERATIONS, MOMENTUM, hidden, others};
use nerd_cuda::{Batch, Op};

/// All hidden matrices of one shape.
struct Group {
    lane: Lane,
    rows: usize,
    columns: usize,
    count: usize,
    gain: f32,
    table: Buffer<[i32; 4]>,
    x: [Buffer<f32>; 2],
    gram: Buffer<f32>,
    polynomial: Buffer<f32>,
}

pub(super) struct Muon {
    groups: Vec<Group>,
    /// By entry of the flat vector: 1 if it belongs to a hidden matrix.
    pub entries: Buffer<u8>,
    fork: Event,
    join: Event,
}

impl Muon {
    pub fn new(device: &Device, network: &TransformerConfig) -> LearnResult<Self> {
        let hidden = hidden(network).concat();
        let mut entries = vec![1u8; network.parameters()];
        others(network).into_iter().for_each(|run| entries[run].fill(0));
        let shapes = hidden.iter().map(|h| (h.rows, h.columns)).collect::<BTreeSet<_>>();
        let group = |((rows, columns), lane): ((usize, usize), Lane)| -> LearnResult<Group> {
            let matrices = hidden.iter().filter(|h| (h.rows, h.columns) == (rows, columns)).collect_vec();
            let count = matrices.len();
            let table: Vec<[i32; 4]> =
                matrices.iter().map(|h| [h.offset as i32, h.stride as i32, i32::from(h.transposed), 0]).collect();
            let zeros = |len: usize| device.zeros::<f32>(count * len);
            Ok(Group {
                lane,
                rows,
                columns,
                count,
                gain: matrices[0].gain(),
                table: device.upload(&table)?,
                x: [zeros(rows * columns)?, zeros(rows * columns)?],
                gram: zeros(rows * rows)?,
                polynomial: zeros(rows * rows)?,
            })
        };
        if shapes.is_empty() {
            mismatch!("a network without hidden matrices");
        }
        let lanes = [Lane::Main, Lane::Side].into_iter().cycle();
        let groups = shapes.into_iter().zip(lanes).map(group).collect::<Result<_, _>>()?;
        Ok(Self { groups, entries: device.upload(&entries)?, fork: device.event()?, join: device.event()? })
    }

    /// Updates all hidden matrices, after the main stream's work so far. `vectors`: addresses of weights, gradients,
    /// momentum, average.
    pub fn update(&self, d: &Device, vectors: [u64; 4], scalars: u64) -> DeviceResult {
        d.mark(Lane::Main, &self.fork)?;
        d.after(Lane::Side, &self.fork)?;
        self.groups.iter().try_for_each(|g| g.update(d, vectors, scalars))?;
        d.mark(Lane::Side, &self.join)?;
        d.after(Lane::Main, &self.join)
    }
}

impl Group {
    fn update(&self, d: &Device, [weights, gradients, m, average]: [u64; 4], scalars: u64) -> DeviceResult {
        let r = self.rows;
        let c = self.columns;
        let n = self.count;
        let grid = |len: usize| (len.div_ceil(256), n);
        let [a, b, k] = COEFFICIENTS;
        let mut x = (&self.x[0], &self.x[1]);
        let wide = r * c;
        let square = r * r;
        let table = &self.table;
        let pack = args![gradients, m, x.0, table, scalars, MOMENTUM, r, c];
        d.launch_on(self.lane, "muon_pack", grid(wide), (256, 1), 0, &pack)?;
        d.launch_on(self.lane, "muon_unit", (n, 1), (1024, 1), 0, &args![x.0, wide])?;
        let [gram, polynomial] = [&self.gram, &self.polynomial].map(|of| (of.ptr, r, square));
        let product =
            |ops, size, a, b, to| d.products(self.lane, Batch { ops: (ops, Op::Plain), size, count: n }, a, b, to);
        for _ in 0..ITERATIONS {
            // Row-major X [r, c] is column-major X^T: X X^T = (X^T)^T X^T.
            let [own, next] = [x.0, x.1].map(|of| (of.ptr, c, wide));
            product(Op::Transposed, (r, r, c), own, own, gram)?;
            product(Op::Plain, (r, r, r), gram, gram, polynomial)?;
            let blend = args![&self.gram, &self.polynomial, a, b, k, r];
            d.launch_on(self.lane, "muon_polynomial", grid(square), (256, 1), 0, &blend)?;
            // P is symmetric: (P X)^T = X^T P.
            product(Op::Plain, (c, r, r), own, polynomial, next)?;
            x = (x.1, x.0);
        }
        let apply = args![weights, average, x.0, table, scalars, self.gain, r, c];
        d.launch_on(self.lane, "muon_apply", grid(wide), (256, 1), 0, &apply)
    }
}
