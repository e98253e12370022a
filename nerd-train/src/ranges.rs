//! Ranges of settings: one out of range is refused by name before any work begins.

use std::fmt::Display;
use std::ops::{Bound, RangeBounds};

use crate::error::part;

/// A setting out of its range.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("`{name}` is {value}, it must be {range}")]
pub struct OutOfRange {
    /// Its key.
    pub name: &'static str,
    /// What it is.
    pub value: String,
    /// What it may be.
    pub range: String,
}

part!(OutOfRange);

/// Refuses a value out of its range; NaN is in none.
pub(crate) fn within<T: PartialOrd + Display>(name: &'static str, value: T, range: impl RangeBounds<T>) -> Result<(), OutOfRange> {
    if range.contains(&value) {
        return Ok(());
    }
    let low = match range.start_bound() {
        Bound::Included(x) => Some(format!("at least {x}")),
        Bound::Excluded(x) => Some(format!("above {x}")),
        Bound::Unbounded => None,
    };
    let high = match range.end_bound() {
        Bound::Included(x) => Some(format!("at most {x}")),
        Bound::Excluded(x) => Some(format!("below {x}")),
        Bound::Unbounded => None,
    };
    let range = [low, high].into_iter().flatten().collect::<Vec<_>>().join(" and ");
    Err(OutOfRange { name, value: value.to_string(), range })
}

/// Above 0, and finite since there is a most.
pub(crate) fn positive<T>(most: T) -> (Bound<T>, Bound<T>)
where
    T: From<u8>,
{
    (Bound::Excluded(T::from(0)), Bound::Included(most))
}
