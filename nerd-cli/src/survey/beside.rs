//! Compares robots with MuJoCo's reading of the same files: masses, contacts, accelerations, standing height.

use nerd_sim::mjcf::is_mjcf;

use super::robot::{Found, caught, reason, text};
use super::{each, stand};
use crate::mujoco::{apart, compare};
use crate::prelude::*;

/// Number of random states at which accelerations are compared.
const STATES: u64 = 100;
/// Time for which floating robots stand (s) before their heights are compared.
const STANDING: f64 = 1.0;
/// Tolerance on the difference between our and MuJoCo's root height (m) after `STANDING`.
const LEVEL: f64 = 3e-3;
/// Tolerance on the relative difference between our and MuJoCo's accelerations.
const ALIKE: f64 = 1e-6;

/// Comparison of one robot file with MuJoCo's reading of it.
struct Beside {
    /// Largest relative difference between our and MuJoCo's accelerations.
    apart: Result<f64, String>,
    /// Number of moving bodies, and number of geom pairs that may touch. `None` for a URDF, which has no scene and no
    /// friction.
    sizes: Option<[usize; 2]>,
    /// Root height above MuJoCo's after standing (m), and angle between both root orientations (rad). `None` for a URDF
    /// or a robot that does not stand.
    stands: Option<Result<[f64; 2], String>>,
    /// Descriptions of mass and contact differences.
    differences: Vec<String>,
}

impl Beside {
    /// Compares a file with MuJoCo's reading of it. `why` converts an error to the text of the file's row.
    fn of(
        Found { path, .. }: &Found,
        system: &Arc<System>,
        python: &Path,
        why: impl Fn(Error) -> String,
    ) -> Result<Self, String> {
        let apart = apart(python, path, system, STATES).map_err(&why);
        if !text(path).is_ok_and(|text| is_mjcf(&text)) {
            return Ok(Self { apart, sizes: None, stands: None, differences: Vec::new() });
        }
        let compared = compare(python, path, system).map_err(&why)?;
        let stands = stand::beside(python, path, system, STANDING).map(|stands| stands.map_err(why));
        Ok(Self { apart, sizes: Some([compared.bodies, compared.pairs]), stands, differences: compared.differences })
    }

    fn equal(&self) -> bool {
        self.differences.is_empty()
    }

    /// Whether our and MuJoCo's accelerations differ only by rounding.
    fn alike(&self) -> bool {
        self.apart.as_ref().is_ok_and(|gap| *gap <= ALIKE)
    }

    /// Writes the root's height above MuJoCo's (mm) and the angle between both (degrees), or the error.
    fn height(&self) -> String {
        match &self.stands {
            Some(Ok([height, turn])) => format!("{:.1}, {:.1} deg", 1e3 * height, turn.to_degrees()),
            Some(Err(reason)) => reason.clone(),
            None => "-".into(),
        }
    }

    fn level(&self) -> bool {
        self.stands.as_ref().is_some_and(|stands| stands.as_ref().is_ok_and(|[height, _]| height.abs() <= LEVEL))
    }

    fn verdict(&self) -> String {
        match (&self.differences[..], &self.apart) {
            ([], Ok(_)) if self.alike() => "equal".into(),
            ([], Ok(_)) => "accelerations differ".into(),
            ([], Err(reason)) => format!("accelerations cannot be compared: {reason}"),
            ([one], _) => one.clone(),
            ([first, more @ ..], _) => format!("{first}; and {} more", more.len()),
        }
    }
}

/// Tables robots compared with MuJoCo's: `equal` if all agrees, else the first difference or why the file is refused.
pub fn beside(files: &[Found], python: &Path) -> Table {
    let one = |found: &Found| {
        caught(|| {
            let name = found.path.display().to_string();
            let why = |error: Error| reason(&format!("{error:#}"), &name);
            let system = System::named(&name).map_err(|error| why(error.into()))?;
            Beside::of(found, &system, python, why)
        })
    };
    let all = each(files, one);
    let read = || all.iter().flatten();
    let note = format!(
        "{} files: {} load; of {} masses, friction, margins and what touches what are MuJoCo's, of {} accelerations, too. Largest difference of \
         accelerations over {STATES} random states, of the largest acceleration of its state, or itself where nothing accelerates; contact, \
         limits, dry friction and actuators off, joints that follow others kept to it in both. Masses of moving bodies to 1e-6 of them, friction \
         and margins (m) to 1e-6; pairs: of geoms that may touch in MuJoCo. Higher: the root of a free robot after {STANDING} s from its \
         default pose, set on the ground, each joint held by the same drive in both, and the turn between them; {} of {} within {} mm.",
        all.len(),
        read().count(),
        read().filter(|one| one.equal()).count(),
        read().filter(|one| one.equal() && one.alike()).count(),
        read().filter(|one| one.level()).count(),
        read().filter(|one| one.stands.is_some()).count(),
        1e3 * LEVEL
    );
    let rows = files.iter().zip(&all).map(|(found, one)| {
        let (gap, sizes, height, verdict) = match one {
            Ok(one) => (
                or_dash(one.apart.as_ref().ok().map(|gap| format!("{gap:.1e}"))),
                one.sizes,
                one.height(),
                one.verdict(),
            ),
            Err(reason) => ("-".into(), None, "-".into(), format!("refused: {reason}")),
        };
        let sizes = sizes.map_or(["-"; 2].map(String::from), |sizes| sizes.map(|n| n.to_string()));
        [found.name.clone(), gap].into_iter().chain(sizes).chain([height, verdict])
    });
    let header =
        ["file", "accelerations apart from MuJoCo's", "moving bodies", "pairs", "higher (mm), turned", "beside MuJoCo"];
    Table::new("beside_mujoco", header).with(rows).noted(note)
}
