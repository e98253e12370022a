//! A small program as one kernel, `whole_pass`: every slot is in shared memory, and a block computes one window, or a few on tensor cores.
//! With many windows of narrow rows, separate kernels would mostly move rows to and from memory.

use std::fmt::Write;

use super::places::{Places, Products};
use crate::program::op::padded;
use crate::program::{Activation, Op, Program, Slot, Step, Weight};

/// Shared bytes that every device gives without asking.
const SHARED: usize = 48 << 10;
/// Most warps of a block.
const MOST_WARPS: usize = 8;
/// Most rows of a block on tensor cores, but where a window alone has more: what its threads sum is in registers.
const MOST_ROWS: usize = 96;

/// A program's pass as a kernel.
pub struct Whole {
    /// Its text.
    pub text: String,
    /// Threads that a block should have.
    pub threads: usize,
    /// Windows that a block passes.
    pub windows: usize,
}

/// What writes the kernel.
struct Writer<'a> {
    program: &'a Program,
    tokens: usize,
    windows: usize,
    products: Products,
    starts: Vec<usize>,
    places: Places<'a>,
    text: String,
}

/// A program over windows of so many tokens `[T][padded inputs]`; none where a step has no such form, or it does not fit.
pub fn whole_program(program: &Program, tokens: usize, products: Products) -> Option<Whole> {
    // Predictions come from a product, and tokens are not changed.
    let last = program.steps.last()?;
    let last = matches!(last.op, Op::Linear { add: false, .. }) && program.steps.iter().filter(|step| step.to == last.to).count() == 1;
    if !last || program.steps.iter().any(|step| step.to == Slot(0)) {
        return None;
    }
    let most = if products == Products::F32 { 1 } else { (MOST_ROWS / tokens).max(1) };
    (1..=most).rev().find_map(|windows| Writer::new(program, tokens, windows, products).whole())
}

impl<'a> Writer<'a> {
    fn new(program: &'a Program, tokens: usize, windows: usize, products: Products) -> Self {
        let places = Places::new(program, windows * tokens, products);
        Self { program, tokens, windows, products, starts: program.starts(), places, text: String::new() }
    }

    fn whole(mut self) -> Option<Whole> {
        let (program, tokens, windows, tensor) = (self.program, self.tokens, self.windows, self.products == Products::Tf32);
        let mut i = 0;
        if tensor {
            let (inputs, x) = (program.width(Slot(0)), self.places.write(Slot(0)));
            let _ = writeln!(self.text, "    take<{inputs}, {}, {}>(tokens, {x}, rows);", padded(inputs), self.places.apart(inputs));
        }
        while i < program.steps.len() {
            i += self.step(i)?;
        }
        let widest = self.places.widest()?;
        // Zeros in place of a row.
        let zeros = program.widths.iter().map(|width| self.places.apart(*width)).max()?;
        let floats = self.places.most + zeros;
        let warps = if tensor { widest.div_ceil(16) } else { (widest.div_ceil(4) * tokens.div_ceil(4)).div_ceil(32) }.min(MOST_WARPS);
        let sizes = [
            ("T", tokens),
            ("WINDOWS", windows),
            ("ROWS", tokens * windows),
            ("WARPS", warps),
            ("INPUTS", padded(program.width(Slot(0)))),
            ("OUTPUTS", program.width(program.predictions())),
            ("FLOATS", floats),
        ];
        let mut text: String = sizes.iter().map(|(name, n)| format!("#define {name} {n}\n")).collect();
        text += include_str!("whole.cuh");
        text += if tensor { include_str!("whole_tf32.cuh") } else { include_str!("whole_f32.cuh") };
        let _ = writeln!(
            text,
            "FN void pass(const float* w, const float* tokens, float* out, float* s, int rows) {{\n    float* none = s + {};\n    \
             EACH(k, {zeros}) none[k] = 0;\n    SYNC;\n{}}}",
            self.places.most, self.text,
        );
        text += include_str!("whole_main.cuh");
        (4 * floats <= SHARED).then_some(Whole { text, threads: 32 * warps, windows })
    }

    /// Writes the step, and the next one if that is done with it; how many were.
    fn step(&mut self, i: usize) -> Option<usize> {
        let Step { from, to, op } = self.program.steps[i];
        let (wide, row) = (self.program.width(to), self.places.apart(self.program.width(to)));
        let mut done = 1;
        match op {
            // Four weights are read at once.
            Op::Linear { weight, .. } if wide.is_multiple_of(4) && !self.starts[weight.0].is_multiple_of(4) => return None,
            Op::Linear { weight, scale: None, bias, add } => {
                let (mut target, mut f) = (to, "same");
                if !add && self.activated(i) {
                    (target, f, done) = (self.program.steps[i + 1].to, "gelu", 2);
                }
                self.plain(from, to)?;
                let (x, apart_x, parts, off) = self.places.read(from)?;
                if self.products == Products::Tf32 && !add {
                    self.places.release(i + done);
                }
                let last = i + done == self.program.steps.len();
                let (y, apart_y) = if last { ("out".into(), wide) } else { (self.places.write(target), row) };
                let inner = self.program.width(from) / parts;
                let bias = bias.map_or_else(|| "(const float*)0".into(), |bias| self.tensor(bias));
                let w = self.tensor(weight);
                let _ = writeln!(
                    self.text,
                    "    linear<{inner}, {parts}, {wide}, {apart_x}, {apart_y}, {add}, {f}>({x}, {off}, {w}, {bias}, {y}, none, rows);"
                );
            }
            Op::Place(table) => {
                let (x, table) = (self.places.write(to), self.tensor(table));
                let _ = writeln!(self.text, "    place<{wide}, {row}>({table}, {x});");
            }
            Op::Norm => {
                let (x, apart_x, ..) = self.places.read(from).filter(|(_, apart_x, parts, _)| *parts == 1 && *apart_x == row)?;
                let y = self.places.write(to);
                let _ = writeln!(self.text, "    norm<{wide}, {apart_x}>({x}, {y});");
            }
            Op::Neighbours(off) => {
                self.places.read(from).filter(|(_, _, parts, _)| *parts == 1)?;
                self.places.beside(to, from, off);
            }
            _ => return None,
        }
        self.places.release(i + done);
        Some(done)
    }

    /// Nothing where a product may not read `from` for `to`: a sum that it adds to itself, or, on tensor cores, what nobody has rounded.
    fn plain(&self, from: Slot, to: Slot) -> Option<()> {
        let source = self.places.source(from);
        let rough = |op: &Op| matches!(op, Op::Linear { .. } | Op::Place(_)) && self.products == Products::Tf32;
        (source != to && !self.program.steps.iter().any(|step| step.to == source && rough(&step.op))).then_some(())
    }

    /// Whether a GELU alone reads what step i writes, and follows it.
    fn activated(&self, i: usize) -> bool {
        let (step, steps) = (self.program.steps[i], &self.program.steps);
        let readers = steps.iter().filter(|other| other.from == step.to).count();
        let follows = |next: &Step| next.from == step.to && next.op == Op::Activate(Activation::Gelu);
        readers == 1 && i + 2 < steps.len() && follows(&steps[i + 1])
    }

    fn tensor(&self, weight: Weight) -> String {
        format!("w + {}", self.starts[weight.0])
    }
}
