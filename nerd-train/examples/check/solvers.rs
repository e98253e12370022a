//! Solvers with the batch on the GPU: motion against the CPU; and one-line errors for an invalid environment, a full
//! memory and too large a robot.

use nerd_model::neural::Neural;
use nerd_model::transformer::packed;
use nerd_sim::articulated::device::Roll;
use nerd_sim::dataset::begin;
use nerd_sim::rig::Rig;

use crate::with::*;

/// A batch of a robot, with scenes and starts as in data sets.
pub fn batch(system: &Arc<System>, n: usize) -> Outcome<Batch> {
    Ok(begin(system, &GenerateConfig { seed: 3, ..GenerateConfig::default() }, 0, n)?)
}

/// Torques of one frame. On a cable only the gripper is driven.
fn torques(batch: &Batch, frame: usize) -> Vec<f64> {
    let joints = batch.system.robot.joint_count();
    let (driven, size) = if joints > 20 { (6, 0.5) } else { (joints, 5.0) };
    let torque = |k: usize| if k % joints.max(1) < driven { size * ((k + 31 * frame) as f64 * 0.7).sin() } else { 0.0 };
    (0..batch.len() * joints).map(torque).collect()
}

pub fn solvers(checks: &mut Checks) -> Outcome {
    let (ant, family, lead) = (System::named("ant")?, System::named("ant-family")?, System::named("lead-pegs")?);
    let (full, short) = (Precision::F32, Precision::Tf32);
    // Last: tolerance of the median environment against the CPU after 30 frames. Motions may diverge at an edge; most
    // do not. TF32 and f16 round 2^13 times as coarsely as f32.
    for (setting, precision, system, most) in [
        (SolverSpec::default(), full, &ant, 1e-4),
        (SolverSpec::default(), full, &family, 1e-4),
        (SolverSpec::neural("models/ant"), full, &ant, 1e-4),
        (SolverSpec::neural("models/ant"), Precision::F16, &ant, 0.1),
        (SolverSpec::neural("models/lead-pegs"), full, &lead, 0.05),
        (SolverSpec::neural("models/lead-pegs"), short, &lead, 0.1),
        (SolverSpec::implicit(4), full, &lead, 1e-2),
    ] {
        let new = || resident(&setting, system, Real::F64, precision);
        let (mut one, mut all, mut cpu) = (batch(system, 64)?, batch(system, 64)?, batch(system, 64)?);
        let (mut stepped, mut own) = (new()?, setting.solver(system, 1)?);
        if system.spec.vary.is_some() {
            own = Box::new(Rig::new(own));
        }
        let frames: Vec<Vec<f64>> = (0..30).map(|frame| torques(&one, frame)).collect();
        for torques in &frames {
            stepped.step(&mut one, torques)?;
            own.step(&mut cpu, torques)?;
        }
        new()?.roll(&mut all, &frames.concat(), 30)?;
        let name = format!("{} in {setting}, {precision:?}", system.name);
        checks.demand(
            one.states == all.states && one.frames == all.frames,
            format!("{name}: frames one by one and in a row, the same bits"),
        );
        let d = system.robot.state_dim();
        let mut apart: Vec<f64> = one.states.chunks(d).zip(cpu.states.chunks(d)).map(|(a, b)| largest(a, b)).collect();
        apart.sort_by(f64::total_cmp);
        checks.demand(
            apart[32] < most,
            format!("{name}: {:.1e} from the CPU in the median of 64, {:.1e} at most", apart[32], apart[63]),
        );

        let (mut sound, mut harmed) = (batch(system, 64)?, batch(system, 64)?);
        harmed.states[41 * d + 9] = f64::NAN;
        new()?.step(&mut sound, &frames[0])?;
        let error = new()?.step(&mut harmed, &frames[0]).err().map_or_else(String::new, |e| e.to_string());
        let others = |b: &Batch| [&b.states[..41 * d], &b.states[42 * d..]].concat();
        checks.demand(
            error.contains("environment 41") && others(&sound) == others(&harmed),
            format!("{name}: one that is not a number: {error}"),
        );

        let begin = batch(system, 64)?.state(3).to_vec();
        one.reset(3, &begin);
        stepped.reset(3);
        let (mut fresh, mut other) = (batch(system, 64)?, new()?);
        for torques in &frames[..3] {
            stepped.step(&mut one, torques)?;
            other.step(&mut fresh, torques)?;
        }
        checks.demand(
            one.state(3) == fresh.state(3),
            format!("{name}: an environment that begins anew, the bits of a fresh one"),
        );
    }
    refused(checks, &ant)?;
    // A cube has no torques to upload.
    let cube = System::named("cube")?;
    let (mut there, mut here, config) = (batch(&cube, 4)?, batch(&cube, 4)?, ArticulatedConfig::accurate(&cube));
    CudaArticulated::new(config, Real::F64).roll(&mut there, &[], 3)?;
    let mut solver = Articulated::new(config);
    (0..3).try_for_each(|_| solver.step(&mut here, &[]))?;
    let off = largest(&there.states, &here.states);
    checks.demand(off < 1e-9, format!("cubes, three frames: {off:.1e} from the CPU"));
    // Hills have no kernels, so only the network runs on the GPU.
    let (mut there, mut here, hills) = (batch(&ant, 100)?, batch(&ant, 100)?, ant.scene("hills")?);
    [&mut there, &mut here].iter_mut().for_each(|batch| batch.scenes.fill(hills.clone()));
    for (device, batch) in [(Device::CudaF32, &mut there), (Device::Cpu, &mut here)] {
        let mut solver = device.neural(Path::new("models/ant"), &ant, None, 100)?;
        (0..3).try_for_each(|frame| solver.step(batch, &torques(batch, frame)))?;
    }
    let off = largest(&there.states, &here.states);
    checks.demand(off < 1e-4, format!("hills, by the network alone: {off:.1e} from the CPU after 3 frames"));
    Ok(())
}

/// A network on the CPU that records its last tokens and predictions.
struct Noted(Box<dyn Stream>, Arc<Mutex<[Vec<f32>; 2]>>);

impl Stream for Noted {
    fn push(&mut self, tokens: &[f32], out: &mut Vec<f32>) -> Result<(), ForwardError> {
        self.0.push(tokens, out)?;
        *self.1.lock().unwrap_or_else(|lost| lost.into_inner()) = [tokens.to_vec(), out.clone()];
        Ok(())
    }

    fn clear(&mut self, env: usize) {
        self.0.clear(env);
    }
}

/// Errors of the Ant model's predictions against the CPU, by precision of the matrix products.
pub fn predictions(checks: &mut Checks) -> Outcome {
    let (ant, folder, n) = (System::named("ant")?, Path::new("models/ant"), 8192);
    let (mut many, model) = (batch(&ant, n)?, Model::load(folder, &ant, None)?);
    let setting = SolverSpec::neural(folder);
    // After 25 frames without torque most robots have fallen.
    let idle = vec![0.0; n * ant.robot.joint_count()];
    resident(&setting, &ant, Real::F32, Precision::F32)?.roll(&mut many, &idle, 25)?;
    let noted = Arc::new(Mutex::default());
    Neural::new(model.clone(), Box::new(Noted(packed(&model.weights), noted.clone())))
        .step(&mut many.clone(), &idle)?;
    let [tokens, wanted] = noted.lock().unwrap_or_else(|lost| lost.into_inner()).clone();
    let mut errors = Vec::new();
    for precision in [Precision::F32, Precision::Tf32, Precision::F16] {
        let mut found = Vec::new();
        CudaStream::new(&model.weights, precision, n)?.push(&tokens, &mut found)?;
        let off = found.iter().zip(&wanted).map(|(a, b)| f64::from((a - b).abs()));
        let most = worse(0.0, off.clone());
        errors.push((off.map(|x| x * x).sum::<f64>() / wanted.len() as f64).sqrt());
        println!("   {precision:?}: predictions {most:.1e} of a change's spread from the CPU's at most");
    }
    let [full, short, half] = errors[..] else { return Ok(()) };
    checks.demand(
        full < 1e-5 && half < short,
        format!("f32, TF32 and f16 are {full:.1e}, {short:.1e} and {half:.1e} from the CPU"),
    );
    Ok(())
}

/// Errors for a GPU whose memory is full, and for a robot too large for a thread.
fn refused(checks: &mut Checks, ant: &Arc<System>) -> Outcome {
    let device = nerd_cuda::Device::open("", &[])?;
    let (mut taken, mut piece) = (Vec::new(), 1usize << 34);
    while piece > 1 << 16 {
        match device.zeros::<u8>(piece) {
            Ok(memory) => taken.push(memory),
            Err(_) => piece /= 2,
        }
    }
    let mut many = batch(ant, 2000)?;
    let torques = torques(&many, 0);
    let mut step = || CudaArticulated::new(ArticulatedConfig::accurate(ant), Real::F64).step(&mut many, &torques).err();
    let error = step().map_or_else(String::new, |e| e.to_string());
    drop(taken);
    checks.demand(
        ["allocating", "MEMORY", "ALLOC"].iter().any(|word| error.contains(word)),
        format!("a full memory: {error}"),
    );
    checks.demand(step().is_none(), "and once there is room".into());

    let link = |k: usize| {
        format!(
            r#"<link name="l{k}"><inertial><mass value="1"/><inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial></link>
            <joint name="j{k}" type="revolute"><parent link="{}"/><child link="l{k}"/><axis xyz="0 1 0"/>
            <limit lower="-3" upper="3" effort="1" velocity="9"/></joint>"#,
            if k == 0 { "base".into() } else { format!("l{}", k - 1) }
        )
    };
    let text = format!(r#"<robot name="chain"><link name="base"/>{}</robot>"#, (0..400).map(link).collect::<String>());
    let system = Arc::new(System::bare("chain", &text, false)?);
    let mut solver = CudaArticulated::new(ArticulatedConfig::accurate(&system), Real::F32);
    let error = solver
        .step(&mut Batch::new(&system, &system.scene("free")?, 2), &[0.0; 800])
        .err()
        .map_or_else(String::new, |e| e.to_string());
    checks.demand(error.contains("too large") && !error.contains('\n'), format!("400 joints: {error}"));
    Ok(())
}
