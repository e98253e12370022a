//! Recurrent cells on the device, token by token of all windows together.

use nerd_cuda::Arg::{Int, Ptr};
use nerd_cuda::{Arg, Buffer, DeviceError, Lane, Op};

use super::network::Network;
use super::passes::Size;

/// Windows, columns of a state, and whether it is an LSTM.
type Shape = (usize, usize, bool);

fn wide((_, e, lstm): Shape) -> usize {
    if lstm { 4 * e } else { 3 * e }
}

impl Network {
    /// States at `out` of what tokens give the gates, with a bias that is added to it. `saved` are the states before each token, what the
    /// backward pass needs, and what states give the gates.
    pub fn cell(&self, saved: &[Buffer<f32>], of: Shape, [weight, bias]: [u64; 2], u: (u64, Arg), out: u64) -> Result<(), DeviceError> {
        let ([before, kept, v], (windows, e, lstm), t) = (saved, of, self.plan.tokens) else { return Ok(()) };
        for k in 0..t {
            if k > 0 {
                self.linear((before.at(k * e), t * e), weight, v.ptr, Size { rows: windows, inner: e, columns: wide(of) }, 0.0)?;
            }
            let arrays = [Ptr(u.0), u.1, Ptr(v.ptr), Ptr(bias), Ptr(out), Ptr(before.ptr), Ptr(kept.ptr)];
            let shape = [Int(k), Int(e), Int(usize::from(lstm)), Int(windows)];
            self.launch_each("cell_forward", windows * e, &[&arrays[..], &shape].concat())?;
        }
        Ok(())
    }

    /// The backward pass, the newest token first, from the gradient `dy` of states to `du` and `dv`; `dh` and `dc` go from token to token.
    pub fn cell_back(&self, saved: &[Buffer<f32>], of: Shape, weight: u64, [dy, du, dv, dh, dc]: [u64; 5]) -> Result<(), DeviceError> {
        let ([before, kept, _], (windows, e, lstm), t) = (saved, of, self.plan.tokens) else { return Ok(()) };
        for k in (0..t).rev() {
            let arrays = [dy, before.ptr, kept.ptr, du, dv, dh, dc].map(Ptr);
            let shape = [Int(k), Int(e), Int(usize::from(lstm)), Int(windows)];
            self.launch_each("cell_backward", windows * e, &[&arrays[..], &shape].concat())?;
            if k > 0 {
                let (ops, size) = ((Op::Transposed, Op::Plain), (e, windows, wide(of)));
                let dv = (dv + 4 * (k * wide(of)) as u64, t * wide(of));
                self.device.product(Lane::Main, ops, size, (weight, wide(of)), dv, 1.0, (dh, e))?;
            }
        }
        Ok(())
    }
}
