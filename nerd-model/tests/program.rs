//! Every operation on the CPU against its meaning in burn: outputs, gradients by weights, gradients by tokens.
#![cfg(feature = "autodiff")]

use burn::tensor::{Device, Tensor, TensorData};
use nerd_model::program::cpu::{Loaded, Memory, Pass};
use nerd_model::program::{Activation, Network, Op, Program, Step};
use nerd_model::transformer::Init;

const WINDOWS: usize = 5;
const TOKENS: usize = 6;

/// A linear step, the operation, and a linear step: what is behind an operation is no plain sum, what is before it has weights.
fn around(width: usize, operation: impl Fn(&mut Program, nerd_model::program::Slot)) -> Program {
    let mut p = Program::new(3);
    let x = p.linear("first", p.tokens(), width, [Init::Normal(0.8), Init::Normal(0.5)]);
    operation(&mut p, x);
    let y = p.predictions();
    p.linear("last", y, 2, [Init::Normal(0.8), Init::Normal(0.5)]);
    p
}

fn operations() -> Vec<(&'static str, Program)> {
    let cell = |lstm: bool, gates: usize| {
        around(gates * 5, move |p, x| {
            let weight = p.tensor("cell.weight", &[5, gates * 5], Init::Normal(0.7));
            let bias = p.tensor("cell.bias", &[gates * 5], Init::Normal(0.4));
            p.then(x, 5, Op::Cell { weight, bias, lstm });
        })
    };
    let attend = |band: Option<usize>| {
        let mut p = around(36, |p, x| {
            p.then(x, 12, Op::Attend { heads: 2, band });
        });
        p.frequencies = if band.is_some() { vec![1.0, 0.3, 0.1] } else { Vec::new() };
        p
    };
    vec![
        ("linear", around(7, |_, _| {})),
        ("place", {
            around(7, |p, x| {
                let table = p.tensor("table", &[9, 7], Init::Normal(1.0));
                p.steps.push(Step { from: x, to: x, op: Op::Place(table) });
            })
        }),
        (
            "norm and scale",
            around(9, |p, x| {
                p.normed("norm", "normed", x, 4, Init::Normal(0.9));
            }),
        ),
        ("residual", {
            around(9, |p, x| {
                let y = p.normed("norm", "normed", x, 4, Init::Normal(0.9));
                p.residual("back", y, x, Init::Normal(0.9));
            })
        }),
        ("attention over a window", attend(None)),
        ("attention over a band", attend(Some(3))),
        (
            "neighbours",
            around(7, |p, x| {
                p.then(x, 21, Op::Neighbours(2));
            }),
        ),
        (
            "neighbours beyond the window",
            around(7, |p, x| {
                p.then(x, 21, Op::Neighbours(TOKENS + 1));
            }),
        ),
        (
            "gelu",
            around(7, |p, x| {
                p.then(x, 7, Op::Activate(Activation::Gelu));
            }),
        ),
        (
            "relu",
            around(7, |p, x| {
                p.then(x, 7, Op::Activate(Activation::Relu));
            }),
        ),
        ("GRU", cell(false, 3)),
        ("LSTM", cell(true, 4)),
    ]
}

fn apart(a: &[f32], b: &[f32]) -> f32 {
    assert_eq!(a.len(), b.len());
    let largest = b.iter().fold(1e-3f32, |m, x| m.max(x.abs()));
    a.iter().zip(b).fold(0.0f32, |m, (a, b)| m.max((a - b).abs())) / largest
}

#[test]
fn every_operation_and_its_gradients_are_burns() {
    for (name, program) in operations() {
        let flat: Vec<f32> = (0..*program.starts().last().expect("an end")).map(|i| (i as f32 * 0.73).sin() * 0.8 + 0.1).collect();
        let x: Vec<f32> = (0..WINDOWS * TOKENS * 3).map(|i| (i as f32 * 1.37).sin() * 1.5).collect();
        let behind: Vec<f32> = (0..WINDOWS * TOKENS * 2).map(|i| (i as f32 * 0.41).cos()).collect();

        let device = Device::flex().autodiff();
        let tensor = |x: &[f32], width: usize| Tensor::<3>::from_data(TensorData::new(x.to_vec(), [WINDOWS, TOKENS, width]), &device);
        let (network, tokens) = (Network::of(program.clone(), &flat, &device), tensor(&x, 3).require_grad());
        let y = network.forward(tokens.clone());
        let gradients = (y.clone() * tensor(&behind, 2)).sum().backward();
        let floats = |t: Tensor<3>| t.into_data().iter::<f32>().collect::<Vec<_>>();
        let by_tokens = floats(tokens.grad(&gradients).expect("tokens are asked for"));
        let expected = [floats(y), network.gradients(&gradients), by_tokens];

        let (loaded, mut memory) = (Loaded::new(program, &flat), Memory::default());
        // Twice, since a pass uses the memory of the one before.
        for _ in 0..2 {
            let said = loaded.forward(&x, &mut memory, Pass::Kept(TOKENS)).clone();
            let (by_weights, by_tokens) = loaded.backward(TOKENS, &behind, &mut memory, true);
            for ((found, expected), what) in [said, by_weights, by_tokens].iter().zip(&expected).zip(["output", "weights", "tokens"]) {
                let off = apart(found, expected);
                assert!(off < 2e-5, "{name}, {what}: off by {off:.1e} of the largest entry");
            }
        }
        let rows: Vec<usize> = (0..WINDOWS).map(|w| w * TOKENS + (w + 2) % TOKENS).collect();
        let asked = loaded.forward(&x, &mut Memory::default(), Pass::Windows(TOKENS, &rows)).clone();
        let wanted: Vec<f32> = rows.iter().flat_map(|r| expected[0][r * 2..][..2].to_vec()).collect();
        assert!(apart(&asked, &wanted) < 2e-5, "{name}: rows asked for are not those of the whole pass");
    }
}
