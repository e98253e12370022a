//! [`CudaLearner`]: an update is one launch of a captured graph.
//!
//! `gather -> fold -> forward -> loss -> backward -> norm -> finish -> Adam (and Muon)`.

use super::*;

/// Adam's second beta.
const BETA: f64 = 0.999;

/// The [`Learner`] on a GPU.
pub struct CudaLearner {
    replay: Replay,
    network: Network,
    optimiser: Optimiser,
    config: LearnerConfig,
    train: Data,
    validation: Data,
    total: Buffer<f64>,
}

struct Data {
    x: Buffer<f32>,
    y: Buffer<f32>,
    /// Shape of the windows, without data.
    shape: Windows,
    /// `count`: number of all windows. `per`: windows per trajectory.
    count: usize,
    per: usize,
}

impl CudaLearner {
    /// Resumes `state`, with all windows in GPU memory.
    ///
    /// # Errors
    /// [`LearnError::Mismatch`] if shapes of windows, state and network differ. [`LearnError::Device`] if there is no
    /// GPU, a library is missing or memory runs out.
    pub fn new(
        config: LearnerConfig,
        precision: Precision,
        state: LearnerState,
        [train, validation]: [&Windows; 2],
    ) -> LearnResult<Self> {
        let shape = state.weights.config;
        crate::learner::check(&config, &state, [train, validation])?;
        let network = Network::new(Plan::of(&shape, shape.sequence())?, config.batch, precision, true)?;
        let d = &network.device;
        let data = |w: &Windows| -> LearnResult<Data> {
            let shape = Windows { x: Vec::new(), y: Vec::new(), ..*w };
            Ok(Data { x: d.upload(&w.x)?, y: d.upload(&w.y)?, shape, count: w.len(), per: w.per_trajectory() })
        };
        let total = d.zeros(1)?;
        let validation = data(validation)?;
        let optimiser = Optimiser::new(d, config, &state, BETA)?;
        Ok(Self { replay: Replay::default(), train: data(train)?, config, optimiser, network, validation, total })
    }

    /// Loss and gradient of the next update, before clipping, in the order of the flat weights; makes no update. For
    /// checks.
    pub fn gradient(&mut self) -> LearnResult<(f32, Vec<f32>)> {
        self.differentiate()?;
        let mut g = self.network.device.download(&self.optimiser.gradients)?;
        let squares = g.pop().unwrap_or(f32::NAN);
        Ok((squares * self.mean(), g))
    }

    /// Factor from the sum of squared errors to the loss.
    fn mean(&self) -> f32 {
        let plan = &self.network.plan;
        1.0 / (self.config.batch * plan.tokens * plan.outputs()) as f32
    }

    fn differentiate(&self) -> LearnResult {
        let net = &self.network;
        let own = &self.optimiser;
        let (w, g) = (own.weights.ptr, own.gradients.ptr);
        let LearnerConfig { batch: rows, huber, .. } = self.config;
        self.gather(&self.train, rows, None)?;
        net.fold(w)?;
        net.forward(w, rows)?;
        net.loss(rows, huber, g)?;
        Ok(net.backward(w, Some(g), 0..rows, None)?)
    }

    /// Copies `rows` windows to the network's inputs and targets. `numbers` is the address of their indices; without
    /// it, the windows are drawn for the next update.
    fn gather(&self, data: &Data, rows: usize, numbers: Option<u64>) -> LearnResult {
        let net = &self.network;
        let drawn = (self.optimiser.scalars(), self.config.seed, 0);
        let (scalars, seed, numbers) = numbers.map_or(drawn, |numbers| (0, 0, numbers));
        let Data { x, y, count, per, shape } = data;
        let to = net.at(Slot(0));
        let args = args![x, y, to, &net.targets, scalars, seed, *count, *per, shape.frames, numbers];
        Ok(net.device.launch_blocks("gather", rows, 128, &args)?)
    }
}

impl Learner for CudaLearner {
    fn update(&mut self, lr: f32) -> LearnResult {
        self.optimiser.set_lr(&self.network.device, lr)?;
        self.replay.run(&self.network.device, "update", (), || {
            self.differentiate()?;
            self.optimiser.update(&self.network.device, self.mean())
        })
    }

    fn replace(&mut self, first: usize, fresh: &Windows) -> LearnResult {
        let data = &self.train;
        let d = &self.network.device;
        data.shape.fits(first, fresh, data.count / data.per)?;
        let token = first * data.shape.frames;
        d.write_at(&data.x, token * fresh.inputs, &fresh.x)?;
        Ok(d.write_at(&data.y, token * fresh.outputs, &fresh.y)?)
    }

    fn progress(&mut self) -> LearnResult<Progress> {
        self.optimiser.progress(&self.network.device)
    }

    fn validate(&mut self, windows: usize) -> LearnResult<f32> {
        let net = &self.network;
        let Optimiser { average, gradients, .. } = &self.optimiser;
        let w = average.ptr;
        let outputs = net.plan.outputs();
        let tokens = net.plan.tokens;
        let chosen = validation_rows(self.validation.count, windows);
        let count = chosen.len();
        let numbers = net.device.upload(&chosen)?;
        net.device.write(&self.total, &[0.0])?;
        net.fold(w)?;
        for first in (0..count).step_by(net.rows) {
            let rows = net.rows.min(count - first);
            self.gather(&self.validation, rows, Some(numbers.at(first)))?;
            net.forward(w, rows)?;
            // Every update overwrites the gradients.
            net.loss(rows, None, gradients.ptr)?;
            let error = gradients.at(net.plan.parameters());
            net.device.launch_blocks("add_loss", 1, 1, &args![error, &self.total])?;
        }
        Ok((net.device.download(&self.total)?[0] / (count * tokens * outputs) as f64) as f32)
    }

    fn state(&mut self) -> LearnResult<LearnerState> {
        self.optimiser.state(&self.network.device)
    }
}
