//! The text of a program's kernels, and their names.

use nerd_model::program::Op;

use super::plan::Plan;

/// Whether an operation needs them, and their text.
type Kernels = (fn(&Op) -> bool, &'static str);

/// Operations whose kernels are the same for all shapes.
const OPERATIONS: [Kernels; 3] = [
    (|op| matches!(op, Op::Activate(_)), include_str!("kernels/activate.cu")),
    (|op| matches!(op, Op::Cell { .. }), include_str!("kernels/cell.cu")),
    (|op| matches!(op, Op::Neighbours(_)), include_str!("kernels/neighbours.cu")),
];

/// Text so far, and kernels in it.
#[derive(Default)]
pub(super) struct Source {
    pub text: String,
    pub kernels: Vec<&'static str>,
}

impl Source {
    /// Operations that a program has, each with its shape in front.
    pub fn of(plan: &Plan) -> Self {
        let (inputs, outputs) = (plan.inputs(), plan.outputs());
        let mut source = Self::default();
        let tokens = format!("constexpr int T = {}, IN = {inputs}, LDX = {}, OUT = {outputs};", plan.tokens, plan.padded);
        source.add(&tokens, include_str!("kernels/common.cu"));
        source.add("", include_str!("kernels/optimiser.cu"));
        if plan.norm > 0 {
            source.add(&format!("constexpr int NORM = {};", plan.norm), include_str!("kernels/norm.cu"));
        }
        if let Some(attention) = &plan.attention {
            source.add(&attention.constants(), include_str!("kernels/attention.cu"));
        }
        if let Some(hidden) = plan.head() {
            source.add(&format!("constexpr int HID = {hidden};"), include_str!("kernels/head.cu"));
        }
        for (is, text) in OPERATIONS {
            if plan.program.steps.iter().any(|step| is(&step.op)) {
                source.add("", text);
            }
        }
        source
    }

    fn add(&mut self, shape: &str, text: &'static str) {
        self.text.extend([shape, "\n", text]);
        let kernels = text.split("extern \"C\" __global__ void ").skip(1);
        self.kernels.extend(kernels.filter_map(|rest| rest.split('(').next()));
    }
}
