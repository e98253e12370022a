//! Export of a policy as ONNX: observations in, mean actions within [-1, 1] out. A contract in a second file describes
//! both ([`Contract`]).
//!
//! The graph is [`Policy::answer`] and [`crate::ppo::Actor::mean`] in f32:
//!
//! ```text
//! frames ─ newest, differences ─ (x - mean) / scale ─ clip to 5 ─ Gemm, activation, ... Gemm ─ clip to 1 ─ action
//! ```
//!
//! The input is `observation`, `[batch, numbers]`. For stacked observations, it is `observations`,
//! `[batch, frames, numbers]`, newest first. At the start of an episode all frames are the first observation. The graph
//! leaves out the policy's value estimate and the spread of its actions.

mod contract;
mod law;
mod quantity;
mod terms;
mod wire;

use nerd_model::program::Activation;
use nerd_sim::files::{has_keys, replaceable};

use crate::{files::write, ppo::Policy, prelude::*};
use wire::Message;

pub use contract::Contract;
pub use terms::{Action, Law, Seen};

/// Versions of the ONNX operator set and file format. They are the oldest that suffice, for old runtimes; GELU needs
/// newer ones.
fn versions(f: Activation) -> [u64; 2] {
    if f == Activation::Gelu { [20, 9] } else { [13, 7] }
}

/// Codes of the data types of ONNX tensors.
const FLOAT: u64 = 1;
const INT64: u64 = 7;

#[derive(Default)]
struct Graph(Message);

impl Graph {
    fn constant(&mut self, name: &str, kind: u64, shape: &[usize], raw: Vec<u8>) {
        self.0.message(5, |tensor| {
            shape.iter().for_each(|n| _ = tensor.number(1, *n as u64));
            tensor.number(2, kind).bytes(8, name).bytes(9, raw);
        });
    }

    fn floats(&mut self, name: &str, shape: &[usize], x: impl IntoIterator<Item = f32>) {
        self.constant(name, FLOAT, shape, x.into_iter().flat_map(f32::to_le_bytes).collect());
    }

    fn index(&mut self, name: &str, x: usize) {
        self.constant(name, INT64, &[1], (x as i64).to_le_bytes().into());
    }

    /// Adds the node `output = operator(inputs)`, with the attribute `axis` if given.
    fn node(&mut self, operator: &str, inputs: &[&str], output: &str, axis: Option<u64>) {
        self.0.message(1, |node| {
            inputs.iter().for_each(|input| _ = node.bytes(1, input));
            node.bytes(2, output).bytes(3, output).bytes(4, operator);
            axis.into_iter()
                .for_each(|axis| _ = node.message(5, |a| _ = a.bytes(1, "axis").number(3, axis).number(20, 2)));
        });
    }

    /// Adds an input (field 11) or output (field 12) of shape `[batch, shape..]`.
    fn port(&mut self, field: u64, name: &str, shape: &[usize]) {
        let sizes = |sizes: &mut Message| {
            sizes.message(1, |size| _ = size.bytes(2, "batch"));
            shape.iter().for_each(|n| _ = sizes.message(1, |size| _ = size.number(1, *n as u64)));
        };
        let kind = |kind: &mut Message| _ = kind.message(1, |tensor| _ = tensor.number(1, FLOAT).message(2, sizes));
        self.0.message(field, |port| _ = port.bytes(1, name).message(2, kind));
    }
}

/// Name of a policy's input, and its dimensions after the batch.
fn input(policy: &Policy) -> (&'static str, Vec<usize>) {
    let depth = policy.shape.stack;
    let width = policy.shape.observation;
    if depth == 1 { ("observation", vec![width]) } else { ("observations", vec![depth, width]) }
}

/// The ONNX file of a policy.
pub fn model(policy: &Policy) -> Vec<u8> {
    let shape = &policy.shape;
    let mut graph = Graph::default();
    let (seen, sizes) = input(policy);
    graph.port(11, seen, &sizes);
    graph.port(12, "action", &[shape.action]);
    let x = if shape.stack > 1 { stacked(&mut graph, seen, shape.stack) } else { seen };
    let columns = 0..shape.inputs();
    graph.floats("mean", &[columns.len()], policy.seen.mean.iter().map(|x| *x as f32));
    graph.floats("inverse", &[columns.len()], columns.map(|k| policy.seen.scale(k).recip() as f32));
    graph.node("Sub", &[x, "mean"], "centred", None);
    graph.node("Mul", &["centred", "inverse"], "scaled", None);
    for (name, bound) in [("widest", crate::ppo::WIDEST as f32), ("most", 1.0)] {
        graph.floats(name, &[], [bound]);
        graph.floats(&format!("minus {name}"), &[], [-bound]);
    }
    graph.node("Clip", &["scaled", "minus widest", "widest"], "normalised", None);
    let x = layers(&mut graph, "normalised", policy);
    graph.node("Clip", &[&x, "minus most", "most"], "action", None);
    graph.0.bytes(2, "policy");
    let [operators, format] = versions(shape.activation);
    let mut model = Message::default();
    model.number(1, format).bytes(2, PRODUCER).bytes(3, env!("CARGO_PKG_VERSION")).bytes(7, graph.0.0);
    model.message(8, |set| _ = set.bytes(1, "").number(2, operators));
    model.0
}

/// Adds the nodes that replace a stack of observations by the newest one and the differences between neighbours.
/// Returns the name of the result.
fn stacked(graph: &mut Graph, seen: &str, stack: usize) -> &'static str {
    for (name, k) in [("zero", 0), ("one", 1), ("last", stack - 1), ("all", stack)] {
        graph.index(name, k);
    }
    for (part, from, to) in [("newest", "zero", "one"), ("later", "zero", "last"), ("earlier", "one", "all")] {
        graph.node("Slice", &[seen, from, to, "one"], part, None);
    }
    graph.node("Sub", &["later", "earlier"], "differences", None);
    graph.node("Concat", &["newest", "differences"], "stacked", Some(1));
    graph.node("Flatten", &["stacked"], "flat", Some(1));
    "flat"
}

/// Adds the layers of a policy on the input `x`. Returns the name of the mean action.
fn layers(graph: &mut Graph, x: &str, policy: &Policy) -> String {
    let shape = &policy.shape;
    let mut x = x.to_string();
    let widths = shape.widths();
    let mut at = 0;
    for (layer, pair) in widths.windows(2).enumerate() {
        let from = pair[0];
        let to = pair[1];
        let last = layer + 2 == widths.len();
        // The last layer keeps only the mean action.
        let kept = if last { shape.action } else { to };
        let [weight, bias, sum, out] = ["weight", "bias", "sum", "out"].map(|what| format!("layer{layer}.{what}"));
        let rows = policy.flat[at..at + from * to].chunks_exact(to);
        graph.floats(&weight, &[from, kept], rows.flat_map(|row| row[..kept].iter().copied()));
        graph.floats(&bias, &[kept], policy.flat[at + from * to..][..kept].iter().copied());
        at += (from + 1) * to;
        graph.node("Gemm", &[&x, &weight, &bias], &sum, None);
        x = sum;
        if !last {
            let f = match shape.activation {
                Activation::Gelu => "Gelu",
                Activation::Relu => "Relu",
                Activation::Tanh => "Tanh",
                Activation::Elu => "Elu",
            };
            graph.node(f, &[&x], &out, None);
            x = out;
        }
    }
    x
}

/// Name of the producer, written into the ONNX file.
const PRODUCER: &str = "nerd-train";

/// Writes the ONNX file to `out`, and the contract to the same name with the extension `json`.
///
/// # Errors
/// If a file cannot be written, or `out` is the contract's own name.
pub fn export(policy: &Policy, task: &dyn Task, out: &Path) -> Result<Contract> {
    let beside = out.with_extension("json");
    if beside == out {
        refuse!("--out {}: the contract will be there; name the model otherwise, as policy.onnx", out.display());
    }
    // An ONNX file that this function wrote has the producer's name near its start.
    replaceable(out, |bytes| bytes.windows(PRODUCER.len()).take(100).any(|at| at == PRODUCER.as_bytes()))
        .and_then(|()| replaceable(&beside, |_| has_keys(&beside, &["onnx_sha256", "policy_sha256"])))
        .map_err(|e| format!("--out: {e}"))?;
    let bytes = model(policy);
    let contract = Contract::of(policy, task, &bytes, input(policy).0, versions(policy.shape.activation)[0])?;
    let text = serde_json::to_string_pretty(&contract).map_err(Error::file(&beside))?;
    write(out, &bytes)?;
    write(&beside, text + "\n")?;
    Ok(contract)
}
