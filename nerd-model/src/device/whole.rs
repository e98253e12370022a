//! A small program as one kernel, `whole_pass`: every slot stands in the memory that a block shares, and a block passes a window, or a few on
//! tensor cores. Where many windows of narrow rows are passed, kernels one by one would mostly move rows to and fro.

use std::fmt::Write;

use super::padded;
use crate::program::{Activation, Op, Program, Slot, Step, Weight};

/// Shared bytes that every device gives without asking.
const SHARED: usize = 48 << 10;
/// Most warps of a block.
const MOST_WARPS: usize = 8;
/// Most rows of a block on tensor cores, but where a window alone has more: what its threads sum stands in registers.
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

/// How products are reckoned.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Products {
    /// In 32 bits.
    F32,
    /// On tensor cores, operands rounded to TF32: for devices of compute capability 8 and above.
    Tf32,
}

/// Where a slot's rows stand.
#[derive(Clone, Copy)]
enum Home {
    /// From this number of the shared memory on.
    Shared(usize),
    /// As neighbours so many tokens apart of another slot.
    Beside(Slot, usize),
    Nowhere,
}

/// What writes the kernel.
struct Writer<'a> {
    program: &'a Program,
    tokens: usize,
    windows: usize,
    products: Products,
    starts: Vec<usize>,
    homes: Vec<Home>,
    /// Numbers that are taken: first, how many, by which slot.
    taken: Vec<(usize, usize, Slot)>,
    most: usize,
    text: String,
}

/// A program over windows of so many tokens `[T][padded inputs]`; none where a step has no such form, or it does not fit.
pub fn whole_program(program: &Program, tokens: usize, products: Products) -> Option<Whole> {
    // A product says what is predicted, and tokens stay as they are.
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
        let homes = vec![Home::Nowhere; program.widths.len()];
        Self { program, tokens, windows, products, starts: program.starts(), homes, taken: Vec::new(), most: 0, text: String::new() }
    }

    fn whole(mut self) -> Option<Whole> {
        let (program, tokens, windows, tensor) = (self.program, self.tokens, self.windows, self.products == Products::Tf32);
        let mut i = 0;
        if tensor {
            let (inputs, x) = (program.width(Slot(0)), self.write(Slot(0)));
            let _ = writeln!(self.text, "    take<{inputs}, {}, {}>(tokens, {x}, rows);", padded(inputs), self.apart(inputs));
        }
        while i < program.steps.len() {
            i += self.step(i)?;
        }
        let kept = program.widths.iter().zip(&self.homes).skip(1).filter(|(_, home)| !matches!(home, Home::Beside(..)));
        let widest = *kept.map(|(width, _)| width).max()?;
        // Zeros that stand for a row.
        let zeros = program.widths.iter().map(|width| self.apart(*width)).max()?;
        let floats = self.most + zeros;
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
            self.most, self.text,
        );
        text += include_str!("whole_main.cuh");
        (4 * floats <= SHARED).then_some(Whole { text, threads: 32 * warps, windows })
    }

    /// Numbers from one row of a slot to the next in shared memory, so that threads which read at once read different banks.
    fn apart(&self, width: usize) -> usize {
        match self.products {
            Products::F32 => width.next_multiple_of(4) + 4,
            Products::Tf32 => 8 * (width.div_ceil(8) | 1),
        }
    }

    /// Writes the step, and the next one if that is done with it; how many were.
    fn step(&mut self, i: usize) -> Option<usize> {
        let Step { from, to, op } = self.program.steps[i];
        let (wide, row) = (self.program.width(to), self.apart(self.program.width(to)));
        let mut done = 1;
        match op {
            // Four weights are read at once.
            Op::Linear { weight, .. } if wide.is_multiple_of(4) && !self.starts[weight.0].is_multiple_of(4) => return None,
            Op::Linear { weight, scale: None, bias, add } => {
                let (mut target, mut f) = (to, "same");
                if let (false, Some(name)) = (add, self.activated(i)) {
                    (target, f, done) = (self.program.steps[i + 1].to, name, 2);
                }
                self.plain(from, to)?;
                let (x, apart_x, parts, off) = self.read(from)?;
                if self.products == Products::Tf32 && !add {
                    self.release(i + done);
                }
                let last = i + done == self.program.steps.len();
                let (y, apart_y) = if last { ("out".into(), wide) } else { (self.write(target), row) };
                let inner = self.program.width(from) / parts;
                let bias = bias.map_or_else(|| "(const float*)0".into(), |bias| self.tensor(bias));
                let w = self.tensor(weight);
                let _ = writeln!(
                    self.text,
                    "    linear<{inner}, {parts}, {wide}, {apart_x}, {apart_y}, {add}, {f}>({x}, {off}, {w}, {bias}, {y}, none, rows);"
                );
            }
            Op::Place(table) => {
                let (x, table) = (self.write(to), self.tensor(table));
                let _ = writeln!(self.text, "    place<{wide}, {row}>({table}, {x});");
            }
            Op::Norm => {
                let (x, apart_x, ..) = self.read(from).filter(|(_, apart_x, parts, _)| *parts == 1 && *apart_x == row)?;
                let y = self.write(to);
                let _ = writeln!(self.text, "    norm<{wide}, {apart_x}>({x}, {y});");
            }
            Op::Neighbours(off) => {
                self.read(from).filter(|(_, _, parts, _)| *parts == 1)?;
                self.homes[to.0] = Home::Beside(from, off);
            }
            _ => return None,
        }
        self.release(i + done);
        Some(done)
    }

    /// Nothing where a product may not read `from` for `to`: a sum that it adds to itself, or, on tensor cores, what nobody has rounded.
    fn plain(&self, from: Slot, to: Slot) -> Option<()> {
        let source = if let Home::Beside(of, _) = self.homes[from.0] { of } else { from };
        let rough = |op: &Op| matches!(op, Op::Linear { .. } | Op::Place(_)) && self.products == Products::Tf32;
        (source != to && !self.program.steps.iter().any(|step| step.to == source && rough(&step.op))).then_some(())
    }

    /// The activation that alone reads what step i writes, and follows it.
    fn activated(&self, i: usize) -> Option<&'static str> {
        let (step, next) = (self.program.steps[i], self.program.steps.get(i + 1)?);
        let readers = self.program.steps.iter().filter(|other| other.from == step.to).count();
        let alone = next.from == step.to && readers == 1 && i + 2 < self.program.steps.len();
        match next.op {
            Op::Activate(Activation::Gelu) if alone => Some("gelu"),
            Op::Activate(Activation::Relu) if alone => Some("relu"),
            _ => None,
        }
    }

    fn tensor(&self, weight: Weight) -> String {
        format!("w + {}", self.starts[weight.0])
    }

    /// Where a slot is read, how far its rows are apart, of how many parts a row is, and how far those are apart.
    fn read(&self, slot: Slot) -> Option<(String, usize, usize, usize)> {
        let width = self.program.width(slot);
        match self.homes[slot.0] {
            Home::Nowhere if slot == Slot(0) => Some(("tokens".into(), padded(width), 1, 0)),
            Home::Shared(at) => Some((format!("s + {at}"), self.apart(width), 1, 0)),
            Home::Beside(of, off) => self.read(of).map(|(at, row, ..)| (at, row, 3, off)),
            Home::Nowhere => None,
        }
    }

    /// Where a slot is written: where it stands, or in the first place that is free.
    fn write(&mut self, slot: Slot) -> String {
        if let Home::Shared(at) = self.homes[slot.0] {
            return format!("s + {at}");
        }
        let (len, mut at) = (self.windows * self.tokens * self.apart(self.program.width(slot)), 0);
        self.taken.sort_unstable_by_key(|(first, ..)| *first);
        for (first, taken, _) in &self.taken {
            if at + len <= *first {
                break;
            }
            at = first + taken;
        }
        self.taken.push((at, len, slot));
        self.most = self.most.max(at + len);
        self.homes[slot.0] = Home::Shared(at);
        format!("s + {at}")
    }

    /// Frees what no step from `next` on reads, adds to, or reads as neighbours.
    fn release(&mut self, next: usize) {
        let rest = &self.program.steps[next..];
        let met = |slot: Slot| rest.iter().any(|step| step.from == slot || step.to == slot);
        let beside = |home: &Home, slot: Slot| matches!(home, Home::Beside(of, _) if *of == slot);
        let homes = &self.homes;
        let open = |slot: Slot| met(slot) || homes.iter().enumerate().any(|(k, home)| beside(home, slot) && met(Slot(k)));
        self.taken.retain(|(.., slot)| open(*slot));
    }
}
