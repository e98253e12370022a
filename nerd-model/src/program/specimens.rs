//! Test programs, one for every operation and every network, with burn's results as the reference for other engines.

use burn::tensor::{Device, Tensor};

use super::burn::BurnNetwork;
use super::config::{Architecture, Positions, TransformerConfig};
use super::{Activation, Init, Op, Program, Slot, policy};

/// A program with parameters, tokens and an upstream gradient.
pub struct Specimen {
    /// Name of the operation or network.
    pub name: String,
    /// Its program, for tokens of a few numbers.
    pub program: Program,
    /// Parameters, all generic values.
    pub flat: Vec<f32>,
    /// Tokens `[WINDOWS][TOKENS][inputs]`.
    pub tokens: Vec<f32>,
    /// Upstream gradient with respect to the predictions, `[WINDOWS][TOKENS][outputs]`.
    pub upstream: Vec<f32>,
}

/// Number of windows in a specimen.
pub const WINDOWS: usize = 5;
/// Number of tokens per window of a specimen.
pub const TOKENS: usize = 6;

impl Specimen {
    fn new(name: &str, program: Program) -> Self {
        let numbers = |n: usize, f: fn(f32) -> f32| (0..n).map(|i| f(i as f32)).collect();
        Self {
            name: name.into(),
            flat: numbers(program.tensors.iter().map(|t| t.len()).sum(), |i| (i * 0.73).sin() * 0.8 + 0.1),
            tokens: numbers(WINDOWS * TOKENS * program.width(program.tokens()), |i| (i * 1.37).sin() * 1.5),
            upstream: numbers(WINDOWS * TOKENS * program.width(program.predictions()), |i| (i * 0.41).cos()),
            program,
        }
    }

    /// Reference results by burn: predictions, and gradients with respect to parameters and tokens, flat.
    pub fn by_burn(&self) -> [Vec<f32>; 3] {
        let network = BurnNetwork::new(self.program.clone(), &self.flat, &Device::flex().autodiff());
        let tensor = |x: &[f32]| network.tensor(x.to_vec(), WINDOWS, TOKENS);
        let tokens = tensor(&self.tokens).require_grad();
        let y = network.forward(tokens.clone());
        let gradients = (y.clone() * tensor(&self.upstream)).sum().backward();
        let floats = |t: Tensor<3>| t.into_data().iter::<f32>().collect::<Vec<_>>();
        let by_tokens = tokens.grad(&gradients).map_or(vec![0.0; self.tokens.len()], floats);
        [floats(y), network.gradients(&gradients).into_data().iter::<f32>().collect(), by_tokens]
    }
}

/// A specimen of an operation between two linear steps, so that its upstream gradient varies and weights precede it.
fn around(name: &str, width: usize, operation: impl Fn(&mut Program, Slot)) -> Specimen {
    let mut p = Program::new(3);
    let x = p.linear("first", p.tokens(), width, [Init::Normal(0.8), Init::Normal(0.5)]);
    operation(&mut p, x);
    let y = p.predictions();
    p.linear("last", y, 2, [Init::Normal(0.8), Init::Normal(0.5)]);
    Specimen::new(name, p)
}

/// One specimen of each operation.
pub fn operations() -> Vec<Specimen> {
    let attend = |name, band: Option<usize>| {
        around(name, 48, move |p, x| {
            p.frequencies = if band.is_some() { vec![1.0, 0.3, 0.1, 0.03] } else { Vec::new() };
            p.then(x, 16, Op::Attend { heads: 2, band });
        })
    };
    let then = |name, width, op| {
        around(name, 7, move |p, x| {
            p.then(x, width, op);
        })
    };
    let place = |p: &mut Program, x: Slot| p.place("table", x, 9, Init::Normal(1.0));
    vec![
        around("linear", 7, |_, _| {}),
        around("place", 7, place),
        around("place and norm", 10, |p, x| {
            place(p, x);
            p.then(x, 10, Op::Norm);
        }),
        around("norm and scale", 10, |p, x| {
            p.normed("norm", "normed", x, 4, Init::Normal(0.9));
        }),
        around("residual", 10, |p, x| {
            let y = p.normed("norm", "normed", x, 4, Init::Normal(0.9));
            p.residual("back", y, x, Init::Normal(0.9));
        }),
        attend("attention over a window", None),
        attend("attention over a band", Some(3)),
        then("neighbours", 21, Op::Neighbours(2)),
        then("neighbours beyond the window", 21, Op::Neighbours(TOKENS + 1)),
        then("gelu", 7, Op::Activate(Activation::Gelu)),
        then("relu", 7, Op::Activate(Activation::Relu)),
        then("tanh", 7, Op::Activate(Activation::Tanh)),
        then("elu", 7, Op::Activate(Activation::Elu)),
        around("gate", 16, |p, x| _ = p.then(x, 8, Op::Gate)),
    ]
}

/// One specimen of each network, over windows or sequences of [`TOKENS`].
pub fn networks() -> Vec<Specimen> {
    let small = TransformerConfig {
        layers: 2,
        heads: 2,
        block: TOKENS,
        history: TOKENS,
        head: 9,
        ..TransformerConfig::paper(5, 3, 24)
    };
    let all = [Architecture::Transformer, Architecture::Residual, Architecture::Chain];
    let all =
        all.map(|architecture| (format!("{architecture:?}"), TransformerConfig { architecture, ..small }.program()));
    let rotary = TransformerConfig { positions: Positions::Rotary, history: 3, ..small };
    let others =
        [("rotary Transformer", rotary.program()), ("policy", policy(&[5, 24, 9, 4], Activation::Elu, Some(3)))];
    let all = all.into_iter().chain(others.map(|(name, program)| (name.to_string(), program)));
    let specimen = |(name, program): (String, Program)| {
        let mut specimen = Specimen::new(&name, program);
        // Deep networks need smaller parameters, so that outputs stay small.
        specimen.flat.iter_mut().for_each(|w| *w *= 0.4);
        specimen
    };
    all.map(specimen).collect()
}
