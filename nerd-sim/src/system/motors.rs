//! Motors and sensors, between a robot's links and its controller. [`crate::rig`] steps them.

/// Frames by which torques may act late.
pub const LATEST: f64 = 2.0;
/// Waves of the ripple in a turn, or over a metre.
pub(crate) const WAVES: f64 = 6.0;

/// Motors and sensors of a robot's joints. What is empty is as it should be.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Motors {
    /// Frames by which torques act late, from 0 to 2.
    pub delay: f64,
    /// Factor on the torque of each joint.
    pub strength: Vec<f64>,
    /// Positions of the joints where their sensors show 0 (rad or m).
    pub zeros: Vec<f64>,
    /// Torque (N m or N) of each joint that a frame adds, times the sine of six times the position where it begins: an effect that no
    /// analytic solver of ours has.
    pub ripple: Vec<f64>,
    /// Line of torque over speed of each joint's motor, of direct current: its torque at rest (N m or N) falls to nothing at a speed (rad/s or
    /// m/s). A frame's torque keeps below the line at the speed where it begins.
    pub lines: Vec<[f64; 2]>,
    /// Size of the white noise on what sensors show of each joint (rad or m): on its position, and over a frame time on its velocity. What is
    /// recorded has it ([`crate::dataset`]) and what a policy sees ([`crate::disturb`]), nothing that is stepped.
    pub noise: f64,
    /// The same of where a free root is (m), and how it is turned (rad).
    pub root_noise: [f64; 2],
    /// Frames by which what a policy sees is late.
    pub lag: f64,
}

impl Motors {
    /// Whether torques act as they are asked for and sensors show where joints are, but for noise.
    pub fn ideal(&self) -> bool {
        let all = |x: &[f64], value: f64| x.iter().all(|x| *x == value);
        self.delay == 0.0 && all(&self.strength, 1.0) && all(&self.zeros, 0.0) && all(&self.ripple, 0.0) && self.lines.is_empty()
    }

    /// Torques of a frame: of those asked for now, a frame ago and so on, by joint positions and velocities as they are.
    pub(crate) fn act(&self, asked: &[&[f64]], positions: &[f64], velocities: &[f64], out: &mut [f64]) {
        late(self.delay, asked, out);
        for (tau, ([rest, top], qd)) in out.iter_mut().zip(self.lines.iter().zip(velocities)) {
            // Where a speed is no number there is no torque: what is wrong with the state is said where it is stepped.
            let share = |left: f64| if left > 0.0 { left.min(1.0) } else { 0.0 };
            let side = |sign: f64| rest * share(1.0 - sign * qd / top);
            *tau = tau.clamp(-side(-1.0), side(1.0));
        }
        out.iter_mut().zip(&self.strength).for_each(|(tau, factor)| *tau *= factor);
        let ripple = self.ripple.iter().zip(positions).map(|(size, q)| size * (WAVES * q).sin());
        out.iter_mut().zip(ripple).for_each(|(tau, more)| *tau += more);
    }
}

/// The mean over a frame of torques that come `delay` frames late: of those asked for now, a frame ago and so on, the last of which counts
/// for all before.
pub(crate) fn late(delay: f64, asked: &[&[f64]], out: &mut [f64]) {
    let (whole, last) = (delay as usize, asked.len() - 1);
    let [now, before] = [whole, whole + 1].map(|k| asked[k.min(last)]);
    let share = delay - whole as f64;
    out.iter_mut().zip(now.iter().zip(before)).for_each(|(tau, (now, before))| *tau = now + share * (before - now));
}
