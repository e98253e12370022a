//! The text of a program's kernels, and their names.

use nerd_model::program::Op;

use super::plan::Plan;

/// Text and kernels of what a program has operations for, with its shapes in front.
pub(super) fn source(plan: &Plan) -> (String, Vec<&'static str>) {
    let Plan { tokens, padded, norm, attention, .. } = plan;
    let (inputs, outputs) = (plan.inputs(), plan.outputs());
    let any = |is: fn(&Op) -> bool| plan.program.steps.iter().any(|step| is(&step.op));
    let texts = [
        (true, include_str!("kernels/common.cu")),
        (true, include_str!("kernels/optimiser.cu")),
        (*norm > 0, include_str!("kernels/norm.cu")),
        (attention.is_some(), include_str!("kernels/attention.cu")),
        (any(|op| matches!(op, Op::Activate(_))), include_str!("kernels/activate.cu")),
        (any(|op| matches!(op, Op::Gate)), include_str!("kernels/gate.cu")),
        (any(|op| matches!(op, Op::Neighbours(_))), include_str!("kernels/neighbours.cu")),
    ];
    let texts: Vec<&'static str> = texts.into_iter().filter(|(has, _)| *has).map(|(_, text)| text).collect();
    let constants = format!(
        "constexpr int T = {tokens}, IN = {inputs}, LDX = {padded}, OUT = {outputs}, NORM = {norm};\n\
         constexpr bool BIASED = {};\n{}\n",
        plan.biased(),
        attention.map_or(String::new(), |attention| attention.constants()),
    );
    let names = texts.iter().flat_map(|text| text.split("extern \"C\" __global__ void ").skip(1));
    (constants + &texts.concat(), names.filter_map(|rest| rest.split('(').next()).collect())
}
