//! What is compared: the bars of the paper's Figure A.2, and a control of our own.

use nerd_train::run::{RunConfig, Variant};

#[derive(Clone, Copy, Debug)]
pub struct Bar {
    pub name: &'static str,
    change: fn(&mut RunConfig),
    /// Error divided by NeRD's, read off the paper's bars: double pendulum, Ant.
    pub paper: Option<[f64; 2]>,
}

/// The bar that all others are divided by.
pub const NERD: &str = "h = 10";

const fn bar(name: &'static str, change: fn(&mut RunConfig), paper: Option<[f64; 2]>) -> Bar {
    Bar { name, change, paper }
}

/// All of them, in the paper's order. The paper says of h = 20 only that its loss sometimes explodes.
pub static BARS: [Bar; 13] = [
    bar("LSTM", |r| r.variant = Variant::Lstm, Some([1.8, 7.4])),
    bar("GRU", |r| r.variant = Variant::Gru, Some([4.8, 11.9])),
    bar("MLP", |r| (r.variant, r.history) = (Variant::Mlp, 1), Some([8.9, 11.5])),
    bar("E2E", |r| r.variant = Variant::EndToEnd, Some([56.1, 19.8])),
    bar("Abs Pred", |r| r.variant = Variant::Absolute, Some([26.8, 5.4])),
    bar("World Frame", |r| r.variant = Variant::World, Some([1.1, 23.3])),
    bar("No Inp. Norm", |r| r.variant = Variant::RawInputs, Some([3.3, 3.6])),
    bar("No Out. Norm", |r| r.variant = Variant::RawOutputs, Some([1.6, 5.3])),
    bar("h = 1", |r| r.history = 1, Some([4.4, 4.1])),
    bar("h = 5", |r| r.history = 5, Some([2.1, 5.2])),
    bar(NERD, |_| (), Some([1.0, 1.0])),
    bar("h = 20", |r| r.history = 20, None),
    // As many tokens an update as NeRD.
    bar("h = 1, 10x", |r| (r.batch, r.history) = (r.batch * r.history, 1), None),
];

impl Bar {
    /// Letters and digits of its name, for a folder and a command line.
    pub fn slug(&self) -> String {
        let lower = self.name.to_lowercase().replace(|c: char| !c.is_ascii_alphanumeric(), " ");
        lower.split_whitespace().collect::<Vec<_>>().join("-")
    }

    /// NeRD's run with this change, in a folder of its own inside NeRD's.
    pub fn run(&self, nerd: &RunConfig) -> RunConfig {
        let mut run = nerd.clone();
        (self.change)(&mut run);
        run.out = nerd.out.join(self.slug());
        run
    }
}
