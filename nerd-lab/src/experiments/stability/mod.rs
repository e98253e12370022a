//! The stability map: every row of [`nerd_sim::suite`] under every analytic method.

mod methods;

#[cfg(feature = "cuda")]
use nerd_sim::articulated::device::{CudaArticulated, Real};
use nerd_sim::suite::{Cell, Line, Method, Suite, Verdict};

use crate::prelude::*;
pub use methods::{accurate, converged, known, paper};

#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct StabilityMap {
    pub methods: Vec<String>,
    pub rows: Vec<Line>,
}

impl StabilityMap {
    /// The figures with a mark: nothing for a pass, `!` for degraded, `!!` for failed, `lost` where the solver gave up.
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
            start.into_iter().chain(l.cells.iter().map(cell)).collect()
        });
        let header: Vec<&str> = ["row", "figure", "limit"].into_iter().chain(self.methods.iter().map(String::as_str)).collect();
        Table::new("stability", &header)
            .with(rows)
            .noted("!: up to ten times the limit; !!: beyond; lost: the solver gave up; -: it lacks what the row needs.")
    }
}

/// The suite under all analytic methods.
pub struct Stability {
    name: String,
    suite: Suite,
    methods: Vec<Method>,
}

impl Stability {
    /// The rows with one of `words` in their names, or all.
    pub fn new(words: &[String]) -> Result<Self> {
        Ok(Self { name: "stability".into(), suite: Suite::new().only(words)?, methods: known() })
    }

    /// The same rows under the articulated solver's settings on a GPU, each beside its own on the CPU.
    #[cfg(feature = "cuda")]
    pub fn on_device(words: &[String]) -> Result<Self> {
        // Settings by system and factor on the substeps.
        type Settings = fn(&System, usize) -> ArticulatedConfig;
        let gpu = |name: &str, real: Real, config: Settings| {
            methods::articulated(name, config, move |config| -> Box<dyn Solver> { Box::new(CudaArticulated::new(config, real)) })
        };
        let of: [(&str, Settings); 2] = [
            ("accurate", |system, times| ArticulatedConfig::implicit(times * system.spec.substeps, Friction::Coulomb)),
            ("implicit x16", |_, times| ArticulatedConfig::implicit(16 * times, Friction::Coulomb)),
        ];
        let mut methods = Vec::new();
        for (name, config) in of {
            methods.extend(known().into_iter().filter(|method| method.name == name));
            methods.push(gpu(&format!("{name}, GPU, 32 bits"), Real::F32, config));
            methods.push(gpu(&format!("{name}, GPU, 64 bits"), Real::F64, config));
        }
        Ok(Self { name: "stability-device".into(), suite: Suite::new().only(words)?, methods })
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
            for setting in [Setting::Accurate, Setting::Euler(16), Setting::Implicit(16), Setting::RapierSteps(4)] {
                inputs.add(Input::motion(robot, scene, &setting)?);
            }
            inputs.add(Input::motion(&format!("{robot}-paper"), scene, &Setting::Paper)?);
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
