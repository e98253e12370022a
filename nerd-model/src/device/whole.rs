//! The network of a chain as one kernel, `whole_pass`: its rows are in shared memory, and a block computes one window. With many windows of
//! narrow rows, separate kernels would mostly move rows to and from memory.

use std::fmt::Write;

use crate::program::op::padded;
use crate::program::{Activation, Op, Program, Slot, Step};

/// Shared bytes that every device gives without asking.
const SHARED: usize = 48 << 10;
/// Most warps of a block.
const MOST_WARPS: usize = 8;

/// Arithmetic of the products.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Products {
    /// In 32 bits.
    F32,
    /// On tensor cores, operands rounded to f16: for devices of compute capability 8 and above.
    F16,
}

/// A program's pass as a kernel.
pub struct Whole {
    /// Its text.
    pub text: String,
    /// Threads that a block should have.
    pub threads: usize,
    /// Windows that a block passes.
    pub windows: usize,
    /// Bytes that it shares.
    pub shared: usize,
    /// Arithmetic of the products.
    pub products: Products,
}

/// Sizes as a text has them.
pub(super) fn defined(sizes: &[(&str, usize)]) -> String {
    sizes.iter().map(|(name, n)| format!("#define {name} {n}\n")).collect()
}

/// A chain's program (`program/networks.rs`); none of another form, or where it does not fit.
pub(super) fn chain(program: &Program, tokens: usize) -> Option<Whole> {
    let [embed, place, blocks @ .., last, out] = &program.steps[..] else { return None };
    let ((blocks, []), Op::Place(table), h) = (blocks.as_chunks::<5>(), place.op, embed.to) else { return None };
    let follow = |from: Slot, steps: &[Step]| steps.iter().try_fold(from, |at, step| (step.from == at).then_some(step.to));
    let in_line = follow(Slot(0), &[*embed, *place]) == Some(h) && blocks.iter().all(|block| follow(h, block) == Some(h));
    if blocks.is_empty() || !in_line || follow(h, &[*last, *out]).is_none() || last.op != Op::Norm {
        return None;
    }

    let starts = program.starts();
    let [inputs, e, outputs] = [Slot(0), h, out.to].map(|slot| program.width(slot));
    // Numbers from one row to the next in shared memory, so that threads which read at once read different banks.
    let apart = |width: usize| width.next_multiple_of(4) + 4;
    // Of h, of what is normed, and of what is active.
    let (row, size) = (apart(e), tokens * apart(e));

    let linear = |step: &Step, (x, apart_x): (&str, usize), (parts, off): (usize, usize), (y, apart_y): (&str, usize), f: &str| {
        let Op::Linear { weight, scale: None, bias, add } = step.op else { return None };
        let (inner, wide) = (program.width(step.from) / parts, program.width(step.to));
        let bias = bias.map_or_else(|| "(const float*)0".into(), |bias| format!("w + {}", starts[bias.0]));
        // Four weights are read at once.
        let aligned = !wide.is_multiple_of(4) || starts[weight.0].is_multiple_of(4);
        let sizes = format!("<{inner}, {parts}, {wide}, {apart_x}, {apart_y}, {add}, {f}>");
        aligned.then(|| format!("    linear{sizes}({x}, {off}, w + {}, {bias}, {y}, none, rows);\n", starts[weight.0]))
    };
    let [stream, normed, active] = [0, size, 2 * size].map(|at| format!("s + {at}"));
    let [stream, normed, active] = [&stream, &normed, &active].map(|at| (at.as_str(), row));
    let norm = format!("    norm<{e}, {row}>({}, {});\n", stream.0, normed.0);
    let mut pass = linear(embed, ("tokens", padded(inputs)), (1, 0), stream, "same")?;
    let _ = writeln!(pass, "    place<{e}, {row}>(w + {}, {});", starts[table.0], stream.0);
    for [before, near, wide, activate, mix] in blocks {
        let (Op::Norm, Op::Neighbours(off), Op::Activate(Activation::Gelu)) = (before.op, near.op, activate.op) else { return None };
        if program.width(wide.to) != e || mix.to != h {
            return None;
        }
        pass += &norm;
        pass += &linear(wide, normed, (3, off), active, "gelu")?;
        pass += &linear(mix, active, (1, 0), stream, "same")?;
    }
    pass += &norm;
    pass += &linear(out, normed, (1, 0), ("out", outputs), "same")?;

    // Zeros in place of a row.
    let zeros = program.widths.iter().map(|width| apart(*width)).max()?;
    let (most, floats) = (3 * size, 3 * size + zeros);
    let warps = (e.max(outputs).div_ceil(4) * tokens.div_ceil(4)).div_ceil(32).min(MOST_WARPS);
    let sizes = [
        ("T", tokens),
        ("WINDOWS", 1),
        ("ROWS", tokens),
        ("WARPS", warps),
        ("INPUTS", padded(inputs)),
        ("OUTPUTS", outputs),
        ("FLOATS", floats),
    ];
    let mut text = defined(&sizes);
    text += include_str!("whole.cuh");
    text += include_str!("whole_f32.cuh");
    let _ = writeln!(
        text,
        "FN void pass(const float* w, const float* tokens, float* out, float* s, int rows) {{\n    float* none = s + {most};\n    \
         EACH(k, {zeros}) none[k] = 0;\n    SYNC;\n{pass}}}",
    );
    text += include_str!("whole_main.cuh");
    let products = Products::F32;
    (4 * floats <= SHARED).then_some(Whole { text, threads: 32 * warps, windows: 1, shared: 4 * floats, products })
}
