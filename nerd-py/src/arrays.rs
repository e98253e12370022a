//! Checks, copies and creates numpy arrays.

use numpy::{
    Element, PyArray1, PyArrayDescrMethods, PyArrayDyn, PyArrayMethods, PyUntypedArray, PyUntypedArrayMethods,
};
use pyo3::exceptions::{PyTypeError, PyValueError};
use pyo3::prelude::*;

/// A float64 array for Python.
pub type Floats<'py> = Bound<'py, PyArrayDyn<f64>>;

/// Elements of an array with exactly this dtype and one of these shapes, in row-major order; `what` names the argument.
///
/// # Errors
/// `TypeError` for another object or dtype, `ValueError` for another shape.
pub fn numbers<T: Element + Copy>(what: &str, given: &Bound<'_, PyAny>, shapes: &[&[usize]]) -> PyResult<Vec<T>> {
    let wanted = numpy::dtype::<T>(given.py());
    let form = shapes.iter().map(|shape| format!("{shape:?}")).collect::<Vec<_>>().join(" or ");
    let Ok(array) = given.cast::<PyUntypedArray>() else {
        let found = given.get_type().name()?;
        return Err(PyTypeError::new_err(format!("{what}: a numpy array of {wanted} {form} is needed, not a {found}")));
    };
    let Ok(array) = array.cast::<PyArrayDyn<T>>() else {
        let found = array.dtype();
        // An array in another byte order has another dtype, so the error names the byte order.
        let known = if found.is_native_byteorder() == Some(false) { ", in this machine's byte order," } else { "" };
        let remedy = if wanted.kind() == b'b' { String::new() } else { format!("; take .astype(\"{wanted}\")") };
        return Err(PyTypeError::new_err(format!(
            "{what}: numbers of {wanted}{known} are needed, not of {found}{remedy}"
        )));
    };
    if !shapes.contains(&array.shape()) {
        return Err(PyValueError::new_err(format!("{what}: an array {form} is needed, not {:?}", array.shape())));
    }
    // Read-only borrows may overlap; an array that Rust writes to cannot be borrowed.
    let array = array.try_readonly().map_err(|e| PyValueError::new_err(format!("{what}: {e}")))?;
    // Elements in row-major order, whatever the array's strides.
    Ok(array.as_array().iter().copied().collect())
}

/// A new numpy array of shape `shape`, with `numbers` in row-major order.
///
/// # Errors
/// `ValueError` if the count of `numbers` differs from that of the shape.
pub fn made<'py, T: Element>(py: Python<'py>, numbers: Vec<T>, shape: &[usize]) -> PyResult<Bound<'py, PyArrayDyn<T>>> {
    PyArray1::from_vec(py, numbers).reshape(shape)
}
