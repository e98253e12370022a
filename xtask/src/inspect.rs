//! `cargo xtask inspect FOLDER`: a data set as a learner will see it ([`nerd_lab::inspect`]); or, with `--robot` alone, a robot's
//! specification.

use nerd_lab::{inspect::Inspection, survey::verdict};
use nerd_sim::{dataset::Manifest, system::Source};

use crate::prelude::*;

#[derive(clap::Args, Clone, Debug)]
pub struct InspectArgs {
    /// Folder that `dataset` wrote
    #[arg(required_unless_present = "robot")]
    pub folder: Option<PathBuf>,
    /// Robot: built in, or the path of a .urdf or MJCF (.xml) [default: the one the folder names]
    #[arg(long)]
    pub robot: Option<String>,
    /// Largest number in a state; trajectories beyond it are left out and counted
    #[arg(long, default_value_t = 1e3, value_parser = value::<f64>(Positive))]
    pub bound: f64,
}

pub fn run(args: InspectArgs) -> Result<()> {
    let folder = match (&args.folder, &args.robot) {
        (Some(folder), _) => folder,
        (None, robot) => return known(robot.as_deref().unwrap_or_default()),
    };
    let manifest = Manifest::read(folder)
        .with_context(|| format!("no data set to inspect; make one with `cargo xtask dataset --out {}`", folder.display()))?;
    let robot = args.robot.as_ref().unwrap_or(&manifest.robot);
    let system = System::named(robot).with_context(|| {
        format!("{} is of robot `{1}`; name its file: --robot PATH/{1}.urdf, of a cable PATH/{1}.toml", folder.display(), manifest.robot)
    })?;
    let found = Inspection::of(folder, &manifest, &system, args.bound)?;
    crate::out::tables(&[found.counted(), found.table()]);
    Ok(())
}

/// A robot's specification as TOML, with what was taken for granted and whether it stands.
fn known(robot: &str) -> Result<()> {
    let system = System::named(robot)?;
    let (links, joints, points) = (system.robot.links.len(), system.robot.joint_count(), system.robot.contact_points.len());
    say!("# {}: {links} links, {joints} joints, {points} contact points, {:.3} kg", system.name, system.robot.mass());
    system.notes.iter().for_each(|note| say!("# {note}"));
    // A built-in robot's file exists and is complete; a cable's has the keys besides `[cable]`.
    if System::texts(&system.name).is_none() && system.source != Source::Cable {
        say!("like = \"urdf\"");
    }
    say!("{}", system.spec_text());
    say!("# {}", verdict(&system, 1.0));
    Ok(())
}
