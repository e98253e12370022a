//! Text of a [`SolverSpec`]: `ENGINE` or `ENGINE(ARGUMENT, KEY=VALUE, ...)`. Settings left out have their defaults.

use std::fmt;
use std::str::FromStr;

use super::{ArticulatedSpec, Method, NeuralSpec, RapierSpec, SolverSpec};
use crate::{bounds::SUBSTEPS, device::Device, error::Error, prelude::*};

/// Engines and their arguments, for messages.
const FORMS: &str = "articulated, rapier or neural; in brackets articulated has substeps=N, method=implicit|euler|rk4|paper, settled and a device, \
                     rapier steps=N, iterations=N and axes=root|world, neural a model's folder and a device";
const METHODS: [(Method, &str); 4] =
    [(Method::Implicit, "implicit"), (Method::Euler, "euler"), (Method::Rk4, "rk4"), (Method::Paper, "paper")];

impl FromStr for SolverSpec {
    type Err = Error;

    fn from_str(text: &str) -> Result<Self> {
        let text = text.trim();
        let (engine, inner) = match text.split_once('(') {
            None => (text, ""),
            Some((engine, rest)) => match rest.strip_suffix(')') {
                Some(inner) => (engine.trim_end(), inner),
                None => refuse!("solver `{text}`: a `)` is missing at its end"),
            },
        };
        let mut spec = match engine {
            "articulated" => Self::default(),
            "rapier" => Self::Rapier(RapierSpec::default()),
            "neural" => Self::Neural(NeuralSpec::default()),
            _ => refuse!("solver `{text}`: choose {FORMS}"),
        };
        let mut keys = Vec::new();
        for argument in arguments(inner) {
            let key = argument.split('=').next().unwrap_or(argument).trim();
            let key = if Device::WORDS.contains(&key) { "device" } else { key };
            if keys.contains(&key) {
                refuse!("solver `{text}`: `{key}` is there twice");
            }
            keys.push(key);
            spec.set(argument).map_err(|why| format!("solver `{text}`: {why}"))?;
        }
        if let Self::Articulated(ArticulatedSpec { settled: true, method, .. }) = spec
            && method != Method::Implicit
        {
            refuse!("solver `{text}`: only the implicit method has solves to be settled; leave method= out");
        }
        Ok(spec)
    }
}

/// Whether a text may be the name of a setting.
fn plain(key: &str) -> bool {
    key.chars().all(|c| c.is_ascii_alphanumeric() || c == '_' || c == '-')
}

/// Splits arguments at commas that are not between quotes.
fn arguments(inner: &str) -> Vec<&str> {
    let mut quoted = false;
    let parts = inner.split(|c| {
        quoted ^= c == '"';
        c == ',' && !quoted
    });
    parts.map(str::trim).filter(|part| !part.is_empty()).collect()
}

impl SolverSpec {
    fn set(&mut self, argument: &str) -> Result<(), String> {
        if let Ok(on) = serde_json::from_value::<Device>(argument.into())
            && !matches!(self, Self::Rapier(_))
        {
            *self = self.clone().on(on);
            return Ok(());
        }
        let count = |value: &str| match value.parse::<usize>() {
            Ok(n) if SUBSTEPS.contains(&(n as u64)) => Ok(n),
            _ => Err(format!("`{argument}` needs a whole number from {} to {}", SUBSTEPS.start(), SUBSTEPS.end())),
        };
        let unknown = || Err(format!("`{argument}` means nothing here; there are {FORMS}"));
        match (self, argument.split_once('=').map(|(key, value)| (key.trim(), value.trim()))) {
            (Self::Articulated(own), Some(("substeps", n))) => own.substeps = Some(count(n)?),
            (Self::Articulated(own), Some(("method", word))) => match METHODS.iter().find(|(_, name)| *name == word) {
                Some((method, _)) => own.method = *method,
                None => return unknown(),
            },
            (Self::Articulated(own), None) if argument == "settled" => own.settled = true,
            (Self::Rapier(own), Some(("steps", n))) => own.steps = count(n)?,
            (Self::Rapier(own), Some(("iterations", n))) => own.iterations = count(n)?,
            (Self::Rapier(own), Some(("axes", word @ ("root" | "world")))) => own.world = word == "world",
            // A setting of another engine is not read as a folder. A folder whose name looks like a setting is written
            // in quotes.
            (Self::Neural(own), key) if own.folder.is_none() && !key.is_some_and(|(key, _)| plain(key)) => {
                own.folder = Some(argument.trim_matches('"').into());
            }
            _ => return unknown(),
        }
        Ok(())
    }
}

impl fmt::Display for SolverSpec {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let mut said: Vec<String> = Vec::new();
        let engine = match self {
            Self::Articulated(ArticulatedSpec { method, substeps, settled, .. }) => {
                let name = METHODS.iter().find(|(own, _)| own == method).map_or("", |(_, name)| name);
                said.extend((*method != Method::default()).then(|| format!("method={name}")));
                said.extend(substeps.map(|n| format!("substeps={n}")));
                said.extend(settled.then(|| "settled".into()));
                "articulated"
            }
            Self::Rapier(own) => {
                let usual = RapierSpec::default();
                said.extend((own.steps != usual.steps).then(|| format!("steps={}", own.steps)));
                said.extend((own.iterations != usual.iterations).then(|| format!("iterations={}", own.iterations)));
                said.extend(own.world.then(|| "axes=world".into()));
                "rapier"
            }
            Self::Neural(own) => {
                let folder = own.folder.as_ref().map(|folder| folder.display().to_string());
                let setting = |folder: &str| folder.split_once('=').is_some_and(|(key, _)| plain(key.trim()));
                let odd = |folder: &str| {
                    setting(folder)
                        || folder.contains(',')
                        || folder.trim() != folder
                        || Device::WORDS.contains(&folder)
                };
                said.extend(folder.map(|folder| if odd(&folder) { format!("\"{folder}\"") } else { folder }));
                "neural"
            }
        };
        said.extend((self.device() != Device::Cpu).then(|| self.device().to_string()));
        if said.is_empty() { f.write_str(engine) } else { write!(f, "{engine}({})", said.join(", ")) }
    }
}

impl From<SolverSpec> for String {
    fn from(spec: SolverSpec) -> Self {
        spec.to_string()
    }
}

impl TryFrom<String> for SolverSpec {
    type Error = Error;

    fn try_from(text: String) -> Result<Self> {
        text.parse()
    }
}
