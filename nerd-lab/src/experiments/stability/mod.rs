//! The stability map: every row of [`nerd_suite`] under every analytic method.

mod methods;

#[cfg(feature = "cuda")]
use nerd_sim::articulated::device::Real;
use nerd_suite::{Cell, Line, Method, Suite, Verdict};

use crate::prelude::*;
pub use methods::{accurate, converged, known, method, paper};

#[derive(Serialize, Deserialize)]
pub struct StabilityMap {
    pub methods: Vec<String>,
    pub rows: Vec<Line>,
}

impl StabilityMap {
    /// Tables the figures with marks: none for a pass, `!` degraded, `!!` failed, `lost` if the solver gave up.
    fn table(&self) -> Table {
        let mark = |c: &Cell| match c.verdict {
            _ if c.lost.is_some() => " lost",
            Verdict::Pass | Verdict::Unasked => "",
            Verdict::Degraded => " !",
            Verdict::Fail => " !!",
        };
        let cell = |c: &Cell| or_dash(c.figure.map(digits)) + mark(c);
        let rows = self.rows.iter().map(|l| {
            let start = [l.row.clone(), l.asked(), digits(l.limit)];
            start.into_iter().chain(l.cells.iter().map(cell))
        });
        let header = ["row", "figure", "limit"].into_iter().chain(self.methods.iter().map(String::as_str));
        Table::new("stability", header).with(rows).noted(
            "!: up to ten times the limit; !!: beyond; lost: the solver gave up; -: it lacks what the row needs.",
        )
    }
}

/// An experiment that runs rows of the suite under a set of methods.
pub struct Stability {
    name: String,
    suite: Suite,
    methods: Vec<Method>,
}

impl Stability {
    /// Selects the rows whose names contain one of `words` (all rows if empty), under all analytic methods.
    pub fn new(words: &[String]) -> Result<Self> {
        Self::of("stability", words, known())
    }

    /// Selects rows like `new`, under MuJoCo and three of our methods.
    pub fn beside_mujoco(words: &[String], python: &Path) -> Result<Self> {
        let mut methods = known()
            .into_iter()
            .filter(|method| ["accurate", "implicit x4", "rapier 16x4"].contains(&&*method.name))
            .collect_vec();
        methods.splice(2..2, [4, 16].map(|substeps| methods::mujoco(python, substeps)));
        Self::of("stability-mujoco", words, methods)
    }

    /// Selects rows like `new`, under two solvers on the CPU, and on a GPU in f32 and f64.
    pub fn on_device(words: &[String]) -> Result<Self> {
        built_for(true)?;
        let mut methods = Vec::new();
        for (name, spec) in [("accurate", SolverSpec::default()), ("implicit x16", SolverSpec::implicit(16))] {
            methods.push(method(name, spec.clone()));
            #[cfg(feature = "cuda")]
            for (bits, real) in [("32", Real::F32), ("64", Real::F64)] {
                methods.push(methods::on_gpu(format!("{name}, GPU, {bits} bits"), spec.clone(), real));
            }
        }
        Self::of("stability-device", words, methods)
    }

    fn of(name: &str, words: &[String], methods: Vec<Method>) -> Result<Self> {
        Ok(Self { name: name.into(), suite: Suite::new().only(words)?, methods })
    }

    fn cells(&self) -> usize {
        self.suite.rows().len() * self.methods.len()
    }
}

impl Experiment for Stability {
    fn about(&self) -> Result<About> {
        let mut inputs = Inputs::default();
        for robot in ["pendulum", "franka", "ant", "anymal"] {
            inputs.add(Input::robot(&*System::named(robot)?));
            inputs.add(Input::robot(&*System::named(&format!("{robot}-paper"))?));
        }
        for (robot, scene) in [("pendulum", "ground1"), ("ant", "ground"), ("anymal", "free")] {
            for text in ["articulated", "articulated(method=euler, substeps=16)", "articulated(substeps=16)", "rapier"]
            {
                inputs.add(Input::motion(robot, scene, &text.parse()?)?);
            }
            inputs.add(Input::motion(&format!("{robot}-paper"), scene, &Truth::Paper.into())?);
        }
        Ok(About { name: self.name.clone(), seed: 0, effort: self.cells() as f64, inputs })
    }

    fn measure(&self) -> Result<Measured> {
        let bar = bar("cells", self.cells() as u64);
        let rows = self.suite.run(&self.methods, |done| bar.set(done as u64));
        bar.finish();
        let map = StabilityMap { methods: self.methods.iter().map(|m| m.name.clone()).collect(), rows };
        Measured::new(&map, vec![map.table()])
    }
}
