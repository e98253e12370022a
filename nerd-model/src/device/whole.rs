//! A chain's network as one kernel, `whole_pass`: a block computes one window with all rows in shared memory. With many
//! windows of narrow rows, separate kernels would mostly move rows to and from memory.

use std::fmt::Write;

use nerd_sim::articulated::device::Text;

use crate::program::config::{Architecture, TransformerConfig};
use crate::program::op::{Slot, padded};
use crate::program::{Op, Program, Step};

/// Shared memory (bytes) that a block gets on every device without opt-in.
const SHARED: usize = 48 << 10;
const MOST_WARPS: usize = 8;

/// Arithmetic of the matrix products.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Products {
    /// Operands and sums in f32.
    F32,
    /// Tensor cores with f16 operands and f32 sums, for devices of compute capability 8 and above.
    F16,
}

/// A network's pass as one kernel.
pub struct Whole {
    /// Source text of the kernel.
    pub text: String,
    /// Number of threads in a block.
    pub threads: usize,
    /// Number of windows that a block computes.
    pub windows: usize,
    /// Shared memory of a block (bytes).
    pub shared: usize,
    /// Arithmetic of the matrix products.
    pub products: Products,
}

/// The shape of the network with this program (`program/networks.rs`), if it has this architecture.
pub(super) fn shape(program: &Program, architecture: Architecture) -> Option<TransformerConfig> {
    let steps = program.steps.len();
    let (layers, block) = match architecture {
        Architecture::Chain => (steps.checked_sub(4)? / 5, program.tensors.get(2)?.shape[0]),
        _ => (steps.checked_sub(3)? / 4, 1),
    };
    let [inputs, e, outputs] = [Slot(0), program.steps[0].to, program.predictions()].map(|slot| program.width(slot));
    let shape = TransformerConfig { layers, block, architecture, ..TransformerConfig::paper(inputs, outputs, e) };
    (layers > 0 && shape.program() == *program).then_some(shape)
}

/// The kernel of a chain's program; `None` for another network, or if the network does not fit into the kernel.
pub(super) fn chain(program: &Program, tokens: usize) -> Option<Whole> {
    let TransformerConfig { inputs, outputs, embedding: e, .. } = shape(program, Architecture::Chain)?;
    let [embed, place, blocks @ .., _, out] = &program.steps[..] else { return None };
    let Op::Place(table) = place.op else { return None };
    let starts = program.starts();
    // Row stride in shared memory that avoids bank conflicts.
    let apart = |width: usize| width.next_multiple_of(4) + 4;
    // Row stride and size (floats) of each of these: the residual stream h, the normalised rows, the activations.
    let row = apart(e);
    let size = tokens * apart(e);

    let linear = |step: &Step,
                  (x, apart_x): (&str, usize),
                  (parts, off): (usize, usize),
                  (y, apart_y): (&str, usize),
                  f: &str| {
        let Op::Linear { weight, bias, add, .. } = step.op else { return None };
        let inner = program.width(step.from) / parts;
        let wide = program.width(step.to);
        let bias = bias.map_or_else(|| "(const float*)0".into(), |bias| format!("w + {}", starts[bias.0]));
        // Weights are read four at a time.
        let aligned = !wide.is_multiple_of(4) || starts[weight.0].is_multiple_of(4);
        let sizes = format!("<{inner}, {parts}, {wide}, {apart_x}, {apart_y}, {add}, {f}>");
        aligned.then(|| format!("    linear{sizes}({x}, {off}, w + {}, {bias}, {y}, none, rows);\n", starts[weight.0]))
    };
    let [stream, normed, active] = [0, size, 2 * size].map(|at| format!("s + {at}"));
    let [stream, normed, active] = [&stream, &normed, &active].map(|at| (at.as_str(), row));
    let norm = format!("    norm<{e}, {row}>({}, {});\n", stream.0, normed.0);
    let mut pass = linear(embed, ("tokens", padded(inputs)), (1, 0), stream, "same")?;
    let _ = writeln!(pass, "    place<{e}, {row}>(w + {}, {});", starts[table.0], stream.0);
    for [_, near, wide, _, mix] in blocks.as_chunks().0 {
        let Op::Neighbours(off) = near.op else { return None };
        pass += &norm;
        pass += &linear(wide, normed, (3, off), active, "gelu")?;
        pass += &linear(mix, active, (1, 0), stream, "same")?;
    }
    pass += &norm;
    pass += &linear(out, normed, (1, 0), ("out", outputs), "same")?;

    // A row of zeros stands for tokens beyond the ends of a window.
    let zeros = program.widths.iter().map(|width| apart(*width)).max()?;
    let most = 3 * size;
    let floats = 3 * size + zeros;
    let warps = (e.max(outputs).div_ceil(4) * tokens.div_ceil(4)).div_ceil(32).min(MOST_WARPS);
    let mut text = Text::default();
    text.define([("T", tokens), ("WINDOWS", 1), ("ROWS", tokens), ("WARPS", warps)]);
    text.define([("INPUTS", padded(inputs)), ("OUTPUTS", outputs), ("FLOATS", floats)]);
    let mut text = text.0 + include_str!("whole.cuh") + include_str!("whole_f32.cuh");
    let _ = writeln!(
        text,
        "FN void pass(const float* w, const float* tokens, float* out, float* s, int rows) {{\n    float* none = s + {most};\n    \
         EACH(k, {zeros}) none[k] = 0;\n    SYNC;\n{pass}}}",
    );
    text += include_str!("whole_main.cuh");
    let products = Products::F32;
    (4 * floats <= SHARED).then_some(Whole { text, threads: 32 * warps, windows: 1, shared: 4 * floats, products })
}
