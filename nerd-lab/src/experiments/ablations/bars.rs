//! What is compared: the bars of the paper's Figure A.2, and controls of our own.

use crate::experiments::changes::Change;
use nerd_train::run::{RunConfig, Variant};

/// One bar.
#[derive(Clone, Copy, Debug)]
pub struct Bar {
    /// Column of the figure: a (architectures), b (other decisions), c (window), d (controls that the paper has not).
    pub group: char,
    /// Its name, and how its training differs from NeRD's.
    pub change: Change,
    /// Error divided by NeRD's, read off the paper's bars: double pendulum, Ant.
    pub paper: Option<[f64; 2]>,
}

/// The bar that all others are divided by.
pub const NERD: &str = "h = 10";

const fn bar(group: char, name: &'static str, change: fn(&mut RunConfig), paper: Option<[f64; 2]>) -> Bar {
    Bar { group, change: Change { name, change }, paper }
}

/// All of them, in the paper's order. The paper says of h = 20 only that its loss sometimes explodes.
pub static BARS: [Bar; 13] = [
    bar('a', "LSTM", |r| r.variant = Variant::Lstm, Some([1.8, 7.4])),
    bar('a', "GRU", |r| r.variant = Variant::Gru, Some([4.8, 11.9])),
    bar('a', "MLP", |r| (r.variant, r.history) = (Variant::Mlp, 1), Some([8.9, 11.5])),
    bar('b', "E2E", |r| r.variant = Variant::EndToEnd, Some([56.1, 19.8])),
    bar('b', "Abs Pred", |r| r.variant = Variant::Absolute, Some([26.8, 5.4])),
    bar('b', "World Frame", |r| r.variant = Variant::World, Some([1.1, 23.3])),
    bar('b', "No Inp. Norm", |r| r.variant = Variant::RawInputs, Some([3.3, 3.6])),
    bar('b', "No Out. Norm", |r| r.variant = Variant::RawOutputs, Some([1.6, 5.3])),
    bar('c', "h = 1", |r| r.history = 1, Some([4.4, 4.1])),
    bar('c', "h = 5", |r| r.history = 5, Some([2.1, 5.2])),
    bar('c', NERD, |_| (), Some([1.0, 1.0])),
    bar('c', "h = 20", |r| r.history = 20, None),
    // As many tokens an update as NeRD.
    bar('d', "h = 1, 10x", |r| (r.batch, r.history) = (r.batch * r.history, 1), None),
];
