//! The backward pass over a program's parts.
//!
//! Gradients of matrices run on the side stream while the main one continues. So an upstream gradient is never overwritten in place: the
//! next one goes to another buffer, and its own is reused once the side stream has read it. The gradient of a matrix that adds to a slot
//! is launched with the kernel of the next one: beside the product that follows it, both would take longer (2 to 4 % of large updates on an
//! H100).

use std::collections::VecDeque;
use std::ops::Range;

use nerd_cuda::Op as Operand;

use super::network::BackwardMemory;
use super::passes::{Size, activation_kernels};
use super::*;

/// Buffers of one length that are enough for both streams to go on.
const SOME: usize = 3;

/// Gradients by a slot's rows, and which of the buffers has them, if one.
#[derive(Clone, Copy)]
struct Slope {
    at: u64,
    buffer: Option<usize>,
}

/// The gradient of a matrix: rows that it read, how far they are apart, their gradient, and where it goes.
struct Gradient {
    x: (u64, usize),
    dy: Slope,
    to: u64,
    size: Size,
}

struct Walk<'a> {
    net: &'a Network,
    back: &'a BackwardMemory,
    /// The first of the rows, and how many.
    first: usize,
    rows: usize,
    /// Where gradients by parameters go, if they are asked for.
    to: Option<u64>,
    slopes: Vec<Option<Slope>>,
    free: VecDeque<usize>,
    /// By buffer, whether the side stream reads it.
    read: Vec<bool>,
    /// For the side stream.
    waiting: Vec<Gradient>,
}

impl Network {
    /// From the gradient by the predictions in `targets`, after [`Network::forward`] of at least these rows, to those by the parameters at `w`
    /// and by tokens `[rows][T][inputs]`, if they are to go somewhere. What no step reads keeps the gradient that it has. Rows that are not
    /// the first begin where four numbers of every slot do.
    pub fn backward(&self, w: u64, to: Option<u64>, rows: Range<usize>, by_tokens: Option<u64>) -> Result<(), DeviceError> {
        let Some(back) = &self.back else { return Err(DeviceError("the network was built without a backward pass".into())) };
        let buffers = back.buffers.borrow().len();
        let slopes = vec![None; self.plan.program.widths.len()];
        let (free, read) = ((0..buffers).collect(), vec![false; buffers]);
        let mut walk = Walk { net: self, back, first: rows.start, rows: rows.len(), to, slopes, free, read, waiting: Vec::new() };
        let upstream = self.targets.at(rows.start * self.plan.tokens * self.plan.outputs());
        walk.slopes[self.plan.program.predictions().0] = Some(Slope { at: upstream, buffer: None });
        walk.slopes[0] = by_tokens.map(|at| Slope { at, buffer: None });
        for i in (0..self.plan.parts.len()).rev() {
            walk.part(i, w)?;
        }
        let Some(g) = to else { return Ok(()) };
        walk.give()?;
        self.device.mark(Lane::Side, &back.join)?;
        self.device.after(Lane::Main, &back.join)?;
        self.unfold(w, g)
    }
}

impl Walk<'_> {
    /// Address of a slot's values in the first of the rows.
    fn at(&self, slot: Slot) -> u64 {
        self.net.at(slot) + 4 * (self.first * self.net.plan.tokens * self.net.plan.width(slot)) as u64
    }

    fn part(&mut self, i: usize, w: u64) -> Result<(), DeviceError> {
        let (net, plan) = (self.net, &self.net.plan);
        let n = self.rows * plan.tokens;
        match plan.parts[i] {
            Part::Linear { from, to, weight, folded, add } => {
                let (dy, size) = (self.slope(to)?, Size { rows: n, inner: plan.program.width(from), columns: plan.width(to) });
                if let Some(g) = self.to {
                    self.gradient(Gradient { x: (self.at(from), plan.width(from)), dy, to: net.tensor(g, weight), size });
                    if !add {
                        self.give()?;
                    }
                }
                let matrix = net.matrix(w, weight, folded);
                if from == Slot(0) {
                    if let Some(dx) = self.slopes[0] {
                        self.linear_dx(dy, matrix, dx, size, 0.0)?;
                    }
                } else if let Some(dx) = self.slopes[from.0] {
                    self.settle(dx)?;
                    self.linear_dx(dy, matrix, dx, size, 1.0)?;
                } else {
                    let dx = self.take(from)?;
                    self.linear_dx(dy, matrix, dx, size, 0.0)?;
                }
                if !add {
                    self.done(to);
                }
                Ok(())
            }
            Part::Shift { slot, bias, positions, .. } => {
                let Some(g) = self.to else { return Ok(()) };
                let gradient = |weight| net.tensor(g, weight);
                net.sum_rows(self.slope(slot)?.at, self.rows, plan.width(slot), bias.map(gradient), positions.map(gradient))
            }
            Part::Step(step) => self.step(i, step, w),
        }
    }

    fn step(&mut self, i: usize, Step { from, to, op }: Step, w: u64) -> Result<(), DeviceError> {
        let (net, plan, d) = (self.net, &self.net.plan, &self.net.device);
        let (n, width) = (self.rows * plan.tokens, plan.width(from));
        let dy = self.slope(to)?;
        if let Op::Activate(f) = op {
            let quads = (n * width).div_ceil(4);
            let bias = match i.checked_sub(1).map(|before| plan.parts[before]) {
                Some(Part::Shift { bias: Some(bias), fused: true, .. }) => net.tensor(w, bias),
                _ => 0,
            };
            // Its upstream gradient is not read.
            self.settle(dy)?;
            (self.slopes[to.0], self.slopes[from.0]) = (None, Some(dy));
            let args = [Ptr(self.at(from)), Ptr(bias), Ptr(dy.at), Int(width), Long(quads as u64)];
            return net.launch_each(activation_kernels(f)[1], quads, &args);
        }
        let before = self.slopes[from.0];
        let dx = self.take(from)?;
        match op {
            Op::Norm => {
                let earlier = before.map_or(0, |slope| slope.at);
                let saved = net.saved[i].at(self.first * plan.tokens);
                let args = [Ptr(dy.at), Ptr(self.at(to)), Ptr(saved), Ptr(earlier), Ptr(dx.at), Int(n)];
                d.launch("norm_backward", (n.div_ceil(8), 1), (256, 1), 0, &args)?;
                self.free.extend(before.and_then(|slope| slope.buffer));
            }
            Op::Attend { .. } => {
                let back = |a: Attention| a.backward(d, self.rows, self.at(from), dy.at, dx.at, net.rotations.ptr);
                plan.attention.map_or(Ok(()), back)?;
            }
            Op::Neighbours(apart) => {
                let args = [Ptr(dy.at), Ptr(dx.at), Int(width), Int(apart), Long((n * width) as u64)];
                net.launch_each("neighbours_backward", n * width, &args)?;
            }
            Op::Gate => {
                let quads = n * width / 8;
                let args = [Ptr(self.at(from)), Ptr(dy.at), Ptr(dx.at), Int(width / 2), Long(quads as u64)];
                net.launch_each("gate_backward", quads, &args)?;
            }
            Op::Linear { .. } | Op::Place(_) | Op::Activate(_) => {}
        }
        self.done(to);
        Ok(())
    }

    /// `dW = x^T dy`, once it is given.
    fn gradient(&mut self, gradient: Gradient) {
        gradient.dy.buffer.into_iter().for_each(|buffer| self.read[buffer] = true);
        self.waiting.push(gradient);
    }

    /// Launches gradients on the side stream, after the main stream's work so far.
    fn give(&mut self) -> Result<(), DeviceError> {
        let d = &self.net.device;
        d.mark(Lane::Main, &self.back.fork)?;
        d.after(Lane::Side, &self.back.fork)?;
        for Gradient { x: (x, ld), dy, to, size } in self.waiting.drain(..) {
            let (Size { rows, inner, columns }, ops) = (size, (Operand::Plain, Operand::Transposed));
            d.product(Lane::Side, ops, (columns, inner, rows), (dy.at, columns), (x, ld), 0.0, (to, columns))?;
            if let Some(buffer) = dy.buffer {
                d.mark(Lane::Side, &self.back.buffers.borrow()[buffer].1)?;
            }
        }
        Ok(())
    }

    /// `dx = dy W^T + beta dx`.
    fn linear_dx(&self, dy: Slope, w: u64, dx: Slope, size: Size, beta: f32) -> Result<(), DeviceError> {
        let (Size { rows, inner, columns }, ops) = (size, (Operand::Transposed, Operand::Plain));
        self.net.device.product(Lane::Main, ops, (inner, rows, columns), (w, columns), (dy.at, columns), beta, (dx.at, inner))
    }

    /// The gradient of a slot whose readers are all done.
    fn slope(&self, slot: Slot) -> Result<Slope, DeviceError> {
        self.slopes[slot.0].ok_or_else(|| DeviceError(format!("{slot:?} of the program is written and not read")))
    }

    fn done(&mut self, slot: Slot) {
        self.free.extend(self.slopes[slot.0].take().and_then(|slope| slope.buffer));
    }

    /// A buffer for a slot's gradient: one that nobody reads, or a new one, or where there are some already the one that is free for longest.
    fn take(&mut self, slot: Slot) -> Result<Slope, DeviceError> {
        let len = (self.rows * self.net.plan.tokens * self.net.plan.width(slot)).next_multiple_of(4);
        let mut buffers = self.back.buffers.borrow_mut();
        let long = |buffer: &usize| buffers[*buffer].0.len == len;
        let idle = self.free.iter().position(|buffer| long(buffer) && !self.read[*buffer]);
        let some = (0..buffers.len()).filter(long).count() >= SOME;
        let found = idle.or_else(|| self.free.iter().position(long).filter(|_| some));
        let buffer = match found.and_then(|k| self.free.remove(k)) {
            Some(buffer) => buffer,
            None => {
                buffers.push((self.net.device.zeros(len)?, self.net.device.event()?));
                self.read.push(false);
                buffers.len() - 1
            }
        };
        let slope = Slope { at: buffers[buffer].0.ptr, buffer: Some(buffer) };
        drop(buffers);
        self.settle(slope)?;
        self.slopes[slot.0] = Some(slope);
        Ok(slope)
    }

    /// Waits, before a gradient is written, for the side stream to have read what was there.
    fn settle(&mut self, slope: Slope) -> Result<(), DeviceError> {
        let Some(buffer) = slope.buffer.filter(|buffer| std::mem::take(&mut self.read[*buffer])) else { return Ok(()) };
        if !self.waiting.is_empty() {
            self.give()?;
        }
        self.net.device.after(Lane::Main, &self.back.buffers.borrow()[buffer].1)
    }
}
