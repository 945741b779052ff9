//! The native part of the Python package `etude`: environments that step together without the GIL.
//!
//! Python allocates the arrays and passes them in; this part only fills them
//! (python/etude/_native.pyi has the shapes). Invalid input raises an `EtudeError` and never
//! panics.

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

/// An `EtudeError` with the message of the Rust error.
fn error(why: impl Display) -> PyErr {
    EtudeError::new_err(why.to_string())
}

/// Ids and titles of the built-in songs.
#[pyfunction]
fn songs() -> Vec<(&'static str, &'static str)> {
    repertoire::SONGS.iter().map(|piece| (piece.id, piece.title)).collect()
}

/// Raises the error that drawing such a picture would raise, unless OpenGL is missing.
#[pyfunction]
fn check_picture(width: i64, height: i64, view: &str) -> PyResult<()> {
    pictures::parse(width, height, view).map(|_| ())
}

/// A complete task.
#[pyclass(module = "etude._native", frozen)]
pub(crate) struct Task(TaskConfig);

#[pymethods]
impl Task {
    /// The task of a preset, with single values changed by `path=value`.
    #[staticmethod]
    fn of_preset(preset: &str, changes: Vec<String>) -> PyResult<Self> {
        Ok(Self(etude_lab::resolve(preset, None, &changes).map_err(error)?.task))
    }

    /// From JSON; values that it leaves out are those of the paper's main text.
    #[staticmethod]
    fn of_json(text: &str) -> PyResult<Self> {
        Ok(Self(serde_json::from_str(text).map_err(error)?))
    }

    /// From the JSON that is stored with a policy, without randomness.
    #[staticmethod]
    fn stored(text: &str) -> PyResult<Self> {
        let stored: TaskConfig = serde_json::from_str(text).map_err(error)?;
        Ok(Self(stored.without_randomness()))
    }

    /// All values, as JSON.
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
