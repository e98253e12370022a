//! Exchange of GPU arrays by DLPack capsules, from this package to other libraries and back. The streams of both sides
//! wait for each other's work on an array.

use std::any::Any;
use std::ffi::{CStr, c_void};
use std::ptr;
use std::sync::{Arc, Mutex, PoisonError};

use nerd_cuda::{Beside, Buffer};
use pyo3::exceptions::{PyTypeError, PyValueError};
use pyo3::ffi::{PyCapsule_GetPointer, PyCapsule_IsValid, PyCapsule_New, PyObject};
use pyo3::prelude::*;

use crate::error::value;

/// Name of a DLPack capsule until a consumer takes its content.
const NAME: &CStr = c"dltensor";
/// DLPack's number for the device type CUDA.
const CUDA: i32 = 2;

/// DLPack's data type: type code, bits per number, lanes (1).
#[repr(C)]
#[derive(Clone, Copy, PartialEq, Eq)]
pub struct Kind(u8, u8, u16);

pub const SINGLE: Kind = Kind(2, 32, 1);
pub const DOUBLE: Kind = Kind(2, 64, 1);
pub const BOOL: Kind = Kind(6, 8, 1);

impl Kind {
    fn name(self) -> String {
        let word =
            ["int", "uint", "float", "handle", "bfloat", "complex", "bool"].get(usize::from(self.0)).unwrap_or(&"kind");
        format!("{word}{}", self.1)
    }
}

/// DLPack's struct `DLTensor`.
#[repr(C)]
struct Tensor {
    data: *mut c_void,
    device: [i32; 2],
    axes: i32,
    kind: Kind,
    shape: *mut i64,
    strides: *mut i64,
    first: u64,
}

/// DLPack's struct `DLManagedTensor`.
#[repr(C)]
struct Managed {
    tensor: Tensor,
    /// Address of the boxed [`Kept`] that lives as long as the capsule's content.
    kept: *mut c_void,
    delete: Option<unsafe extern "C" fn(*mut Managed)>,
}

/// Owners of an array's memory and shape, kept as long as a consumer uses the array.
struct Kept {
    shape: Vec<i64>,
    _memory: Arc<dyn Any + Send + Sync>,
}

/// An array on a GPU; other libraries take it by `from_dlpack` without a copy.
#[pyclass(frozen, module = "nerd")]
pub struct CardArray {
    at: u64,
    kind: Kind,
    shape: Vec<i64>,
    memory: Arc<dyn Any + Send + Sync>,
    order: Order,
}

/// The stream that writes an array. For a simulation's states it is the solver's stream.
pub type Order = Arc<Mutex<Beside>>;

/// The stream that writes the array at present.
pub fn beside(order: &Order) -> Beside {
    order.lock().unwrap_or_else(PoisonError::into_inner).clone()
}

impl CardArray {
    /// An array with this data type and shape on shared GPU memory.
    pub fn new<T: 'static, M: Any + Send + Sync>(
        memory: &Arc<M>,
        of: &Buffer<T>,
        kind: Kind,
        shape: &[usize],
        order: &Order,
    ) -> Self {
        debug_assert_eq!(of.len, shape.iter().product::<usize>());
        let shape = shape.iter().map(|n| *n as i64).collect();
        Self { at: of.ptr, kind, shape, memory: memory.clone(), order: order.clone() }
    }
}

unsafe extern "C" fn delete(managed: *mut Managed) {
    // SAFETY: `managed` and `kept` are boxes made by `__dlpack__`, and the consumer calls this function once.
    unsafe {
        let managed = Box::from_raw(managed);
        drop(Box::from_raw(managed.kept.cast::<Kept>()));
    }
}

/// Destructor of a capsule: deletes the content unless a consumer has taken it.
unsafe extern "C" fn end(capsule: *mut PyObject) {
    // SAFETY: Python calls this function once. While the capsule has our name, its content is still ours to delete.
    unsafe {
        if PyCapsule_IsValid(capsule, NAME.as_ptr()) == 1 {
            delete(PyCapsule_GetPointer(capsule, NAME.as_ptr()).cast());
        }
    }
}

#[pymethods]
impl CardArray {
    /// DLPack's number for the device type, and the ordinal of the GPU.
    fn __dlpack_device__(&self) -> (i32, usize) {
        (CUDA, beside(&self.order).ordinal())
    }

    /// A DLPack capsule of the array. The stream with the handle `stream` waits until the array is written.
    #[pyo3(signature = (*, stream=None, max_version=None, dl_device=None, copy=None))]
    fn __dlpack__<'py>(
        &self,
        py: Python<'py>,
        stream: Option<isize>,
        max_version: Option<(u32, u32)>,
        dl_device: Option<(i32, usize)>,
        copy: Option<bool>,
    ) -> PyResult<Bound<'py, PyAny>> {
        let _ = max_version;
        if copy == Some(true) || dl_device.is_some_and(|device| device != self.__dlpack_device__()) {
            return Err(pyo3::exceptions::PyBufferError::new_err(
                "this array stays where it is: take it, then copy it",
            ));
        }
        // A handle of -1 means that the consumer synchronises by itself.
        match stream.unwrap_or(1) {
            -1 => {}
            handle => beside(&self.order).lead(handle as usize).map_err(value)?,
        }
        let mut kept = Box::new(Kept { shape: self.shape.clone(), _memory: self.memory.clone() });
        let tensor = Tensor {
            data: self.at as *mut c_void,
            device: [CUDA, self.__dlpack_device__().1 as i32],
            axes: kept.shape.len() as i32,
            kind: self.kind,
            shape: kept.shape.as_mut_ptr(),
            strides: ptr::null_mut(),
            first: 0,
        };
        let managed = Box::new(Managed { tensor, kept: Box::into_raw(kept).cast(), delete: Some(delete) });
        // SAFETY: the capsule owns its content until a consumer takes it; Python owns the capsule.
        unsafe {
            Bound::from_owned_ptr_or_err(py, PyCapsule_New(Box::into_raw(managed).cast(), NAME.as_ptr(), Some(end)))
        }
    }
}

/// The address of an array on this GPU with exactly this data type and shape, row-major. `stream` waits until the array
/// is written. The caller must make the stream that owns the array wait until the array is read.
///
/// # Errors
/// `TypeError` for another object, device or data type, `ValueError` for another shape or layout.
pub fn address(what: &str, given: &Bound<'_, PyAny>, kind: Kind, shape: &[usize], stream: &Beside) -> PyResult<u64> {
    let wrong = |found: String| {
        PyTypeError::new_err(format!(
            "{what}: an array of {} {shape:?} on the card is needed, not {found}",
            kind.name()
        ))
    };
    let Ok(device) = given.call_method0("__dlpack_device__").and_then(|device| device.extract::<(i32, i32)>()) else {
        return Err(wrong(format!("a {}", given.get_type().name()?)));
    };
    if device != (CUDA, stream.ordinal() as i32) {
        return Err(wrong(format!("one on device {device:?} of DLPack")));
    }
    let asked = pyo3::types::PyDict::new(given.py());
    asked.set_item("stream", stream.handle())?;
    let capsule = given.call_method("__dlpack__", (), Some(&asked))?;
    // SAFETY: a capsule with this name holds a `DLManagedTensor`, and the caller keeps its array alive.
    let tensor = unsafe {
        let managed = PyCapsule_GetPointer(capsule.as_ptr(), NAME.as_ptr()).cast::<Managed>();
        if managed.is_null() {
            return Err(PyErr::take(given.py()).unwrap_or_else(|| wrong("another capsule".into())));
        }
        &(*managed).tensor
    };
    if tensor.kind != kind {
        return Err(wrong(format!("of {}", tensor.kind.name())));
    }
    let axes = tensor.axes.max(0) as usize;
    // SAFETY: shape and strides have one entry per axis; strides may be null.
    let (found, strides) = unsafe {
        let list = |at: *mut i64| {
            if axes == 0 || at.is_null() { Vec::new() } else { std::slice::from_raw_parts(at, axes).to_vec() }
        };
        (list(tensor.shape), list(tensor.strides))
    };
    let wanted: Vec<i64> = shape.iter().map(|n| *n as i64).collect();
    let rows: Vec<i64> = (0..axes).map(|k| found[k + 1..].iter().product()).collect();
    // The stride of an axis with one entry has no effect, so any value is accepted.
    let lies = strides.iter().zip(&rows).zip(&found).all(|((stride, row), n)| stride == row || *n == 1);
    if found != wanted || !lies {
        return Err(PyValueError::new_err(format!(
            "{what}: an array {shape:?} in rows is needed, not {found:?} by strides {strides:?}"
        )));
    }
    Ok(tensor.data as u64 + tensor.first)
}
