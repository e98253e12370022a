//! Actuator and sensor model between a robot's joints and its controller. [`crate::rig`] steps this model.

/// Largest delay of torques (frames).
pub const LATEST: f64 = 2.0;
/// Wave number of torque ripple (1/rad or 1/m): at joint position q, the ripple is an amplitude times `sin(WAVES q)`.
pub(crate) const WAVES: f64 = 6.0;

/// Actuators and sensors of a robot's joints. Empty lists mean ideal actuators and sensors.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Motors {
    /// Delay of torques (frames), 0 to 2.
    pub delay: f64,
    /// Factor on the torque of each joint.
    pub strength: Vec<f64>,
    /// Joint positions (rad or m) where the sensors read 0.
    pub zeros: Vec<f64>,
    /// Amplitude of each joint's torque ripple (N m or N). A frame adds the amplitude times `sin(6 q)`, with the joint
    /// position q (rad or m) at the frame's start. Analytic solvers do not model ripple.
    pub ripple: Vec<f64>,
    /// Torque-speed line of each joint's DC motor: stall torque (N m or N) and no-load speed (rad/s or m/s). The line
    /// bounds a frame's torque at the velocity of the frame's start.
    pub lines: Vec<[f64; 2]>,
    /// Standard deviation of white noise on each joint's measured position (rad or m). On measured velocity it is this
    /// value divided by the frame time (s). Recordings ([`crate::dataset`]) and observations ([`crate::disturb`]) have
    /// noise; stepped states do not.
    pub noise: f64,
    /// Standard deviation of the noise on position (m) and orientation (rad) of a free root.
    pub root_noise: [f64; 2],
    /// Delay of observations (frames).
    pub lag: f64,
}

impl Motors {
    /// Whether torques act as commanded and sensors read joint positions, apart from noise.
    pub fn ideal(&self) -> bool {
        let all = |x: &[f64], value: f64| x.iter().all(|x| *x == value);
        self.delay == 0.0
            && all(&self.strength, 1.0)
            && all(&self.zeros, 0.0)
            && all(&self.ripple, 0.0)
            && self.lines.is_empty()
    }

    /// Writes the joint torques of a frame (N m or N) to `out`. `asked`: commanded torques `[frame][joint]`, from this
    /// frame backwards. `positions` and `velocities`: true joint state at the frame's start.
    pub(crate) fn act(&self, asked: &[&[f64]], positions: &[f64], velocities: &[f64], out: &mut [f64]) {
        late(self.delay, asked, out);
        for (tau, ([rest, top], qd)) in out.iter_mut().zip(self.lines.iter().zip(velocities)) {
            // A NaN velocity gives no torque: the solver then reports the fault of the state.
            let share = |left: f64| if left > 0.0 { left.min(1.0) } else { 0.0 };
            let side = |sign: f64| rest * share(1.0 - sign * qd / top);
            *tau = tau.clamp(-side(-1.0), side(1.0));
        }
        out.iter_mut().zip(&self.strength).for_each(|(tau, factor)| *tau *= factor);
        let ripple = self.ripple.iter().zip(positions).map(|(size, q)| size * (WAVES * q).sin());
        out.iter_mut().zip(ripple).for_each(|(tau, more)| *tau += more);
    }
}

/// Mean over a frame of torques delayed by `delay` frames. `asked`: commanded torques `[frame][joint]`, from this frame
/// backwards; frames before the oldest count as equal to it.
pub(crate) fn late(delay: f64, asked: &[&[f64]], out: &mut [f64]) {
    let whole = delay as usize;
    let last = asked.len() - 1;
    let [now, before] = [whole, whole + 1].map(|k| asked[k.min(last)]);
    let share = delay - whole as f64;
    out.iter_mut().zip(now.iter().zip(before)).for_each(|(tau, (now, before))| *tau = now + share * (before - now));
}
