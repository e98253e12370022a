//! MuJoCo on charts.

pub mod series;
