//! Conversion between parameter buffers and named tensors.

use crate::{buffer::Buffer, network::Plan};

/// Why a tensor cannot be used. Completes "tensor …".
#[derive(Debug, thiserror::Error)]
pub(crate) enum TensorError {
    #[error("`{name}` is missing")]
    Missing { name: String },
    #[error("`{name}` has shape {found:?} instead of {expected:?}")]
    Shape { name: String, found: Vec<usize>, expected: Vec<usize> },
    #[error("`{name}` holds a value that is not a finite number")]
    NotFinite { name: String },
}

/// A tensor of `f32`, to be written to a file.
pub(crate) struct NamedTensor<'a> {
    pub name: String,
    pub shape: Vec<usize>,
    pub values: &'a [f32],
}

/// Appends the tensors of one parameter-like buffer under `prefix`.
pub(crate) fn name_tensors<'a>(plan: &Plan, prefix: &str, buffer: &'a [f32], out: &mut Vec<NamedTensor<'a>>) {
    for tensor in &plan.tensors {
        out.push(NamedTensor {
            name: format!("{prefix}.{}", tensor.name),
            shape: tensor.shape.clone(),
            values: &buffer[tensor.range.clone()],
        });
    }
}

/// Looks tensors up by name: `lookup(name)` gives shape and values.
pub(crate) type Lookup<'a> = dyn Fn(&str) -> Option<(Vec<usize>, Vec<f32>)> + 'a;

/// Looks up one tensor, and checks its shape and that its values are finite.
pub(crate) fn find(lookup: &Lookup<'_>, name: String, expected: &[usize]) -> Result<Vec<f32>, TensorError> {
    let Some((found, values)) = lookup(&name) else { return Err(TensorError::Missing { name }) };
    if found != expected || values.len() != expected.iter().product::<usize>() {
        return Err(TensorError::Shape { name, found, expected: expected.to_vec() });
    }
    if !values.iter().all(|value| value.is_finite()) {
        return Err(TensorError::NotFinite { name });
    }
    Ok(values)
}

/// Fills a parameter-like buffer from tensors under `prefix`.
pub(crate) fn find_tensors(
    plan: &Plan,
    prefix: &str,
    lookup: &Lookup<'_>,
    buffer: &mut Buffer,
) -> Result<(), TensorError> {
    for tensor in &plan.tensors {
        let values = find(lookup, format!("{prefix}.{}", tensor.name), &tensor.shape)?;
        buffer[tensor.range.clone()].copy_from_slice(&values);
    }
    Ok(())
}
