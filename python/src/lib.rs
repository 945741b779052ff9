//! The native part of the Python package `etude`: environments that step together, with the interpreter's lock released.
//!
//! Python decides what arrays there are and hands them over; this part only fills them (python/etude/_native.pyi has the
//! shapes). Whatever it is given, it raises an `EtudeError` and never panics.

mod pianos;
mod pictures;

use std::fmt::Display;

use etude_music::repertoire;
use etude_task::TaskConfig;
use pyo3::create_exception;
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;

create_exception!(
    etude,
    EtudeError,
    PyValueError,
    "Something that Étude was given cannot be used; the message says what."
);

/// The same words as in Rust.
fn error(why: impl Display) -> PyErr {
    EtudeError::new_err(why.to_string())
}

/// Ids and titles of the built-in songs.
#[pyfunction]
fn songs() -> Vec<(&'static str, &'static str)> {
    repertoire::PIECES.iter().map(|piece| (piece.id, piece.title)).collect()
}

/// Raises what drawing such a picture would, but for what the machine lacks.
#[pyfunction]
fn check_picture(width: i64, height: i64, view: &str) -> PyResult<()> {
    pictures::asked(width, height, view).map(|_| ())
}

/// A complete task.
#[pyclass(module = "etude._native", frozen)]
pub(crate) struct Task(TaskConfig);

#[pymethods]
impl Task {
    /// That of a preset with single values changed by `path=value`.
    #[staticmethod]
    fn of_preset(preset: &str, changes: Vec<String>) -> PyResult<Self> {
        Ok(Self(etude_lab::resolve(preset, None, &changes).map_err(error)?.task))
    }

    /// From JSON; what it leaves out is as in the paper's main text.
    #[staticmethod]
    fn of_json(text: &str) -> PyResult<Self> {
        Ok(Self(serde_json::from_str(text).map_err(error)?))
    }

    /// Every value.
    fn json(&self) -> PyResult<String> {
        serde_json::to_string(&self.0).map_err(error)
    }
}

/// The extension.
#[pymodule]
fn _native(module: &Bound<'_, PyModule>) -> PyResult<()> {
    module.add("__version__", env!("CARGO_PKG_VERSION"))?;
    module.add("EtudeError", module.py().get_type::<EtudeError>())?;
    module.add("CONTROL_HZ", etude_music::CONTROL_HZ)?;
    module.add_function(wrap_pyfunction!(songs, module)?)?;
    module.add_function(wrap_pyfunction!(check_picture, module)?)?;
    module.add_class::<Task>()?;
    module.add_class::<pianos::Pianos>()
}
