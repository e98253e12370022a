//! `cargo xtask rollout --robot pendulum --scene ground3 --solver articulated(substeps=128) --states FILE.csv --frames
//! 100 --out OUT.csv`. [`TABLES`] describes the files.

use nerd_sim::{
    files::replaceable,
    rollout::{States, written},
};
use nerd_train::bounds::{memory, time};

use crate::solvers::SolverArgs;
use crate::{options::FRAMES, prelude::*};

/// Help text that describes the files of --states and --out.
const TABLES: &str = "\
FILE of --states has a header and one row per trajectory and step, with these columns:
  traj, step   whole numbers; the row of step 0 is the start of the trajectory
  coordinates  of a floating root px py pz (m) and the unit quaternion qx qy qz qw; then a column JOINT for each joint (rad
               or m); read at step 0 only
  velocities   of a floating root the twist about the world's origin, wx wy wz vx_s vy_s vz_s (rad/s, m/s); then d_JOINT
               for each joint (rad/s or m/s); read at step 0 only
  torques      tau_JOINT (N m or N) for all joints or for none, constant from the row's step to the next; without them, the
               torques are 0
Cartpole has x theta xdot thetadot and tau_cart tau_pole, pendulum q1 q2 qd1 qd2 and tau1 tau2. The TOML of a robot may
give other names. A joint whose name is taken (`step`, `tau1`) becomes q_NAME. The order of the columns is free, and other
columns are ignored.
FILE of --out has traj, step and the state, with all digits of an f64.";

#[derive(clap::Args)]
#[command(after_help = TABLES)]
pub struct RolloutArgs {
    /// Robot: a name from `list robots` (pendulum, ant-paper, ...), or the path of a .urdf, MJCF (.xml) or cable .toml
    #[arg(long)]
    pub robot: String,
    /// Scene: free, plane, slope, box, steps, hills, or one of the robot's own (`list scenes` prints all)
    #[arg(long, default_value = "free")]
    pub scene: String,
    #[command(flatten)]
    pub solver: SolverArgs,
    /// CSV file of starts and torques, see below
    #[arg(long, value_name = "FILE")]
    pub states: PathBuf,
    /// Frames to roll out [default: the largest step of the file]
    #[arg(long, value_parser = value::<usize>(Whole(FRAMES)))]
    pub frames: Option<usize>,
    /// CSV file to write
    #[arg(long, value_name = "FILE")]
    pub out: PathBuf,
}

pub fn run(args: RolloutArgs) -> Result<()> {
    let system = System::named(&args.robot)?;
    let scene = system.scene(&args.scene)?;
    let spec = args.solver.choose(&system)?;
    replaceable(&args.out, |table| written(table, &system)).map_err(|e| anyhow!("--out: {e}"))?;
    if !args.solver.neural() {
        unused(&[("--truth", args.solver.truth.is_some())], "without --solver neural, whose model learned it")?;
    }
    let bytes = crate::describe::bytes(&spec)?.saturating_add(1024 * system.robot.state_dim());
    let file = States::read(&args.states, &system)?;
    let steps = steps(&args, &file)?;
    let n = file.trajectories.len();
    // Counts the memory of the table, which is kept until written: some 20 characters a number.
    memory(&[("trajectories", n), ("--frames", steps)], 24 * (system.robot.state_dim() + 2))?;
    memory(&[("trajectories", n)], bytes)?;
    time(&[("trajectories", n), ("--frames", steps), ("substeps", spec.substeps(&system))])?;
    let mut solver = spec.solver(&system, n)?;
    let bar = bar("frames", steps as u64);
    let table = file.roll(&system, &scene, &mut *solver, steps, &mut |done| bar.set(done as u64))?;
    bar.finish();
    write(&args.out, &table)
}

/// Most frames, summed over trajectories, that a file's last step number may request without --frames. A larger number
/// may be a typing error.
const ASKED: usize = 100_000;

/// Returns the number of frames to roll out. A file with torques must have them for every frame.
fn steps(args: &RolloutArgs, file: &States) -> Result<usize> {
    let name = args.states.display();
    let steps = args.frames.unwrap_or_else(|| file.frames());
    let n = file.trajectories.len();
    if args.frames.is_none() && n.saturating_mul(steps) > ASKED.max(file.rows()) {
        bail!(
            "{name}: {n} trajectories to step {steps}, but only {} rows; say with --frames if so many frames are wanted",
            file.rows()
        );
    }
    if steps == 0 {
        bail!("{name}: there are starts alone, no row after step 0; say with --frames how many frames are wanted");
    }
    file.check(steps)?;
    Ok(steps)
}
