//! `cargo xtask inspect --robot FILE`: what is known of a robot, and what was derived.

use nerd_lab::survey::verdict;
use nerd_sim::system::Source;

use crate::prelude::*;

#[derive(clap::Args, Clone, Debug)]
pub struct InspectArgs {
    /// Robot: built in, or the path of a .urdf or MJCF (.xml)
    #[arg(long)]
    pub robot: String,
}

/// A specification as TOML, with what was taken for granted and whether it stands.
pub fn run(args: InspectArgs) -> Result<()> {
    let system = System::named(&args.robot)?;
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
