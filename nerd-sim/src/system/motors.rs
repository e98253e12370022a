//! The actuator and sensor model between a robot's links and its controller. [`crate::rig`] steps it.

/// Largest delay of torques (frames).
pub const LATEST: f64 = 2.0;
/// Waves of the ripple in a turn, or over a metre.
pub(crate) const WAVES: f64 = 6.0;

/// Motors and sensors of a robot's joints. Empty lists mean ideal ones.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Motors {
    /// Delay of torques (frames), from 0 to 2.
    pub delay: f64,
    /// Factor on the torque of each joint.
    pub strength: Vec<f64>,
    /// Positions of the joints where their sensors show 0 (rad or m).
    pub zeros: Vec<f64>,
    /// Torque ripple of each joint (N m or N): a frame adds this times the sine of six times the position at its start. None of our
    /// analytic solvers models it.
    pub ripple: Vec<f64>,
    /// Torque-speed line of each joint's direct-current motor: its stall torque (N m or N) and its no-load speed (rad/s or m/s). A frame's
    /// torque is bounded by the line at the speed at the frame's start.
    pub lines: Vec<[f64; 2]>,
    /// Standard deviation of the sensors' white noise, by joint (rad or m): on the position, and divided by the frame time on the velocity.
    /// Recordings ([`crate::dataset`]) and observations ([`crate::disturb`]) have it; stepped states do not.
    pub noise: f64,
    /// The same for the position of a free root (m), and for its orientation (rad).
    pub root_noise: [f64; 2],
    /// Delay of observations (frames).
    pub lag: f64,
}

impl Motors {
    /// Whether torques act as commanded and sensors show joint positions, apart from noise.
    pub fn ideal(&self) -> bool {
        let all = |x: &[f64], value: f64| x.iter().all(|x| *x == value);
        self.delay == 0.0 && all(&self.strength, 1.0) && all(&self.zeros, 0.0) && all(&self.ripple, 0.0) && self.lines.is_empty()
    }

    /// Torques of a frame from the commanded ones of this frame, the last one and so on, and from true joint positions and velocities.
    pub(crate) fn act(&self, asked: &[&[f64]], positions: &[f64], velocities: &[f64], out: &mut [f64]) {
        late(self.delay, asked, out);
        for (tau, ([rest, top], qd)) in out.iter_mut().zip(self.lines.iter().zip(velocities)) {
            // A speed that is NaN gives no torque: the solver reports the state's fault.
            let share = |left: f64| if left > 0.0 { left.min(1.0) } else { 0.0 };
            let side = |sign: f64| rest * share(1.0 - sign * qd / top);
            *tau = tau.clamp(-side(-1.0), side(1.0));
        }
        out.iter_mut().zip(&self.strength).for_each(|(tau, factor)| *tau *= factor);
        let ripple = self.ripple.iter().zip(positions).map(|(size, q)| size * (WAVES * q).sin());
        out.iter_mut().zip(ripple).for_each(|(tau, more)| *tau += more);
    }
}

/// Mean over a frame of torques delayed by `delay` frames; `asked` are the commanded ones of this frame, the last one and so on. The oldest
/// stands for all before.
pub(crate) fn late(delay: f64, asked: &[&[f64]], out: &mut [f64]) {
    let (whole, last) = (delay as usize, asked.len() - 1);
    let [now, before] = [whole, whole + 1].map(|k| asked[k.min(last)]);
    let share = delay - whole as f64;
    out.iter_mut().zip(now.iter().zip(before)).for_each(|(tau, (now, before))| *tau = now + share * (before - now));
}
