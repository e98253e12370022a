//! The text of a program's kernels, and their names.

use super::plan::{Part, Plan};

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
        let any = |is: fn(&Part) -> bool| plan.parts.iter().any(is);
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
        if any(|part| matches!(part, Part::Activate { .. })) {
            source.add("", include_str!("kernels/activate.cu"));
        }
        if any(|part| matches!(part, Part::Cell { .. })) {
            source.add("", include_str!("kernels/cell.cu"));
        }
        if any(|part| matches!(part, Part::Neighbours { .. })) {
            source.add("", include_str!("kernels/neighbours.cu"));
        }
        source
    }

    fn add(&mut self, shape: &str, text: &'static str) {
        self.text.extend([shape, "\n", text]);
        let kernels = text.split("extern \"C\" __global__ void ").skip(1);
        self.kernels.extend(kernels.filter_map(|rest| rest.split('(').next()));
    }
}
