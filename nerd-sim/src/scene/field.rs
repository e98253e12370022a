//! Uneven ground: a grid of heights with bilinear interpolation that repeats along x and y, or a finite block with this
//! top.
//!
//! Distance and normal refer to the tangent plane vertically below the point. For a sphere, distance and normal ignore
//! the curvature of the ground beneath.

use std::f64::consts::TAU;
use std::sync::Mutex;

use rand::RngExt;

use crate::{internal::*, random::stream};

/// Nodes of a generated field along x and along y.
const NODES: usize = 128;

/// Kinds of generated ground.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum TerrainKind {
    /// Each node's height is drawn from `U(0, height)`.
    Rubble,
    /// Stairs that rise to the middle of the field from all sides, with steps of `height` and depth `length`.
    Steps,
    /// Slopes that rise to the middle of the field from all sides, by `height` over each `length`.
    Slopes,
    /// Waves along x and y with height `height` and wavelength near `length`.
    Waves,
}

/// Generated ground in a TOML.
#[derive(Clone, Copy, Debug, PartialEq, Deserialize, Serialize)]
#[serde(deny_unknown_fields)]
pub struct TerrainSpec {
    /// Kind of ground.
    pub kind: TerrainKind,
    /// Height (m), as defined by [`TerrainKind`].
    pub height: f64,
    /// Node spacing (m); the field repeats after 128 nodes.
    #[serde(default = "cell")]
    pub cell: f64,
    /// Depth of a step or wavelength (m), for steps, slopes and waves only; default: 1 m, clamped to the field's range.
    pub length: Option<f64>,
    /// Seed of rubble; default: 0.
    pub seed: Option<u64>,
}

fn cell() -> f64 {
    0.1
}

impl TerrainSpec {
    /// Refuses a number out of range.
    pub fn check(&self) -> Result<(), String> {
        within("`height`", self.height, 0.0..=10.0, "m")?;
        within("`cell`", self.cell, 1e-3..=10.0, "m")?;
        match (self.kind, self.length, self.seed) {
            (TerrainKind::Rubble, Some(_), _) => {
                Err("`length` is of steps, slopes and waves; leave it out for rubble".into())
            }
            (TerrainKind::Rubble, None, _) => Ok(()),
            (_, _, Some(_)) => Err("`seed` is of rubble, since nothing else is drawn; leave it out".into()),
            _ => within("`length`", self.depth(), self.depths(), "m"),
        }
    }

    fn depths(&self) -> std::ops::RangeInclusive<f64> {
        self.cell..=NODES as f64 * self.cell
    }

    fn depth(&self) -> f64 {
        self.length.unwrap_or(1.0f64.clamp(*self.depths().start(), *self.depths().end()))
    }
}

/// A grid of heights (m).
#[derive(Clone, Debug)]
pub struct Field {
    cell: [f64; 2],
    nodes: [usize; 2],
    /// Heights `[x][y]`, before scaling.
    heights: Arc<[f64]>,
    highest: f64,
    /// Upper bound of the squared slope, before scaling.
    steepest: f64,
    /// Factor on all heights.
    scale: f64,
    /// Depth (m) of the bottom below height 0, for a finite block.
    base: Option<f64>,
}

impl Field {
    /// A repeating field with heights (m) `[x][y]` at nodes `cell` (m) apart, the first node at the origin.
    ///
    /// # Errors
    /// If the number of heights does not match `nodes`, or a height is not finite or above 1e6 m.
    pub fn new(cell: f64, nodes: [usize; 2], heights: Vec<f64>) -> Result<Self, String> {
        Self::of([cell; 2], nodes, heights, None)
    }

    /// A block centred at the origin, with heights (m) `[x][y]` at nodes `cell` (m) apart along x and y. The bottom of
    /// the block is `base` (m) below height 0.
    ///
    /// # Errors
    /// Under the conditions of [`Field::new`], or if an axis has fewer than two nodes.
    pub fn block(cell: [f64; 2], nodes: [usize; 2], heights: Vec<f64>, base: f64) -> Result<Self, String> {
        within("`base`", base, 1e-9..=1e6, "m")?;
        if nodes.contains(&1) {
            return Err(format!("{} x {} nodes: at least two along each are needed", nodes[0], nodes[1]));
        }
        Self::of(cell, nodes, heights, Some(base))
    }

    fn of(cell: [f64; 2], nodes: [usize; 2], heights: Vec<f64>, base: Option<f64>) -> Result<Self, String> {
        cell.into_iter().try_for_each(|cell| within("`cell`", cell, 1e-6..=1e6, "m"))?;
        let [n, m] = nodes;
        if n == 0 || n.checked_mul(m) != Some(heights.len()) || !heights.iter().all(|h| h.abs() <= 1e6) {
            return Err(format!(
                "{} heights of {n} x {m} nodes: as many finite ones are needed, of at most 1e6 m",
                heights.len()
            ));
        }
        let rise = |axis: usize| {
            let (di, dj) = if axis == 0 { (1, 0) } else { (0, 1) };
            let next = |k: usize| (k / m + di, k % m + dj);
            let inner = (0..n * m).map(|k| (k, next(k))).filter(|(_, (i, j))| base.is_none() || *i < n && *j < m);
            inner
                .map(|(k, (i, j))| ((heights[i % n * m + j % m] - heights[k]) / cell[axis]).powi(2))
                .fold(0.0, f64::max)
        };
        let highest = heights.iter().copied().fold(f64::MIN, f64::max);
        let steepest = rise(0) + rise(1);
        Ok(Self { cell, nodes, heights: heights.into(), highest, steepest, scale: 1.0, base })
    }

    /// Generates the field of a TOML. Repeating the last specification returns the same memory.
    pub(crate) fn drawn(spec: &TerrainSpec) -> Result<Self, String> {
        static LAST: Mutex<Option<(TerrainSpec, Field)>> = Mutex::new(None);
        spec.check()?;
        let mut last = LAST.lock().unwrap_or_else(std::sync::PoisonError::into_inner);
        if let Some((_, field)) = last.as_ref().filter(|(known, _)| known == spec) {
            return Ok(field.clone());
        }
        let TerrainSpec { kind, height, cell, seed, .. } = *spec;
        let length = spec.depth();
        let mut rng = stream(seed.unwrap_or(0), 0);
        let side = NODES as f64 * cell;
        let wave = TAU * (side / length).round().max(1.0) / side;
        let heights = (0..NODES * NODES).map(|k| {
            let [x, y] = [k / NODES, k % NODES].map(|i| i as f64 * cell);
            // Distance from the edge in units of `length`.
            let inward = [x, side - x, y, side - y].into_iter().fold(f64::INFINITY, f64::min) / length;
            match kind {
                TerrainKind::Rubble => height * rng.random::<f64>(),
                TerrainKind::Steps => height * (inward + 1e-9).floor(),
                TerrainKind::Slopes => height * inward,
                TerrainKind::Waves => 0.5 * height * (1.0 + (wave * x).sin() * (wave * y).sin()),
            }
        });
        let field = Self::new(cell, [NODES; 2], heights.collect())?;
        *last = Some((*spec, field.clone()));
        Ok(field)
    }

    /// The field with heights multiplied by `scale`.
    #[must_use]
    pub fn scaled(&self, scale: f64) -> Self {
        Self { scale, ..self.clone() }
    }

    /// Number of nodes along x and y, and their spacing (m).
    pub fn grid(&self) -> ([usize; 2], [f64; 2]) {
        (self.nodes, self.cell)
    }

    /// Whether the field repeats.
    pub fn repeats(&self) -> bool {
        self.base.is_none()
    }

    /// Largest height (m).
    pub fn highest(&self) -> f64 {
        self.highest * self.scale
    }

    /// Period along x and y (m), for a field that repeats.
    pub fn period(&self) -> [f64; 2] {
        [0, 1].map(|k| self.nodes[k] as f64 * self.cell[k])
    }

    /// Half length along x and y (m), for a block.
    fn half(&self) -> [f64; 2] {
        [0, 1].map(|k| 0.5 * (self.nodes[k] - 1) as f64 * self.cell[k])
    }

    /// Height (m) at (x, y), and its slope along x and y. Beyond the edge of a block, returns the values at the edge.
    pub fn at(&self, x: f64, y: f64) -> (f64, [f64; 2]) {
        let ([i, p], a) = self.cell_of(0, x);
        let ([j, q], b) = self.cell_of(1, y);
        let [o, p, q, r] =
            [(i, j), (p, j), (i, q), (p, q)].map(|(i, j)| self.heights[i * self.nodes[1] + j] * self.scale);
        let (low, high) = (o + a * (p - o), q + a * (r - q));
        let along = (p - o) + b * ((r - q) - (p - o));
        (low + b * (high - low), [along / self.cell[0], (high - low) / self.cell[1]])
    }

    /// Indices of the nodes on both sides of a coordinate along an axis, and the fraction between them (NaN for NaN).
    fn cell_of(&self, axis: usize, x: f64) -> ([usize; 2], f64) {
        let u = x / self.cell[axis];
        let n = self.nodes[axis];
        if self.base.is_some() {
            let last = (n - 1) as f64;
            let u = (u + 0.5 * last).clamp(0.0, last);
            let i = u.floor().min(last - 1.0);
            return ([i as usize, i as usize + 1], u - i);
        }
        let i = (u.floor() as i64).rem_euclid(n as i64) as usize;
        ([i, (i + 1) % n], u - u.floor())
    }

    /// Whether bounds prove a point (in the field's axes) to be at least `reach` (m) away: edges, largest height,
    /// steepest slope.
    pub(crate) fn beyond(&self, place: &Vector3<f64>, reach: f64) -> bool {
        let aside =
            || self.base.is_some() && self.half().iter().zip(place.iter()).any(|(half, x)| x.abs() - half >= reach);
        place.z - self.highest() >= reach * (1.0 + self.steepest * self.scale * self.scale).sqrt() || aside()
    }

    /// Distance (m) of a point in the field's axes, and the outward normal. For a block, the largest signed distance
    /// from top, sides and bottom.
    pub(crate) fn over(&self, place: &Vector3<f64>) -> (f64, Vector3<f64>) {
        let (height, [along, aside]) = self.at(place.x, place.y);
        let normal = Vector3::new(-along, -aside, 1.0).normalize();
        let mut found = ((place.z - height) * normal.z, normal);
        if let Some(base) = self.base {
            let side = |k: usize| (place[k].abs() - self.half()[k], Vector3::ith(k, place[k].signum()));
            for other in [side(0), side(1), (-base - place.z, -Vector3::z())] {
                if other.0 > found.0 {
                    found = other;
                }
            }
        }
        found
    }

    /// Factor on all heights.
    pub fn scale(&self) -> f64 {
        self.scale
    }

    /// Node spacings, node counts, largest height, bound of the squared slope, depth of the bottom (0 without),
    /// heights: all before scaling.
    pub(crate) fn numbers(&self) -> Vec<f64> {
        let [cell, wide] = self.cell;
        let [n, m] = self.nodes.map(|n| n as f64);
        let head = [cell, wide, n, m, self.highest, self.steepest, self.base.unwrap_or(0.0)];
        head.into_iter().chain(self.heights.iter().copied()).collect()
    }

    /// Whether both fields share the memory of their heights.
    pub(crate) fn shares(&self, other: &Self) -> bool {
        Arc::ptr_eq(&self.heights, &other.heights)
    }
}
