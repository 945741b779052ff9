//! Conversion between parameter buffers and named tensors.

use crate::{buffer::Buffer, network::ParameterLayout};

/// A tensor of `f32`, to be written to a file.
pub(crate) struct NamedTensor<'a> {
    pub name: String,
    pub shape: Vec<usize>,
    pub values: &'a [f32],
}

/// Appends the tensors of one parameter-like buffer under `prefix`.
pub(crate) fn name_tensors<'a>(
    layout: &ParameterLayout,
    prefix: &str,
    buffer: &'a [f32],
    out: &mut Vec<NamedTensor<'a>>,
) {
    for tensor in &layout.tensors {
        out.push(NamedTensor {
            name: format!("{prefix}.{}", tensor.name),
            shape: tensor.shape.clone(),
            values: &buffer[tensor.range.clone()],
        });
    }
}

/// Looks tensors up by name: `lookup(name)` gives shape and values.
pub(crate) type Lookup<'a> = dyn Fn(&str) -> Option<(Vec<usize>, Vec<f32>)> + 'a;

/// Looks up one tensor, and checks its shape and that its values are finite. `Err` says what is
/// wrong.
pub(crate) fn find(lookup: &Lookup<'_>, name: &str, expected: &[usize]) -> Result<Vec<f32>, String> {
    let (found, values) = lookup(name).ok_or_else(|| format!("tensor `{name}` is missing"))?;
    if found != expected || values.len() != expected.iter().product::<usize>() {
        return Err(format!("tensor `{name}` has shape {found:?} instead of {expected:?}"));
    }
    if !values.iter().all(|value| value.is_finite()) {
        return Err(format!("tensor `{name}` holds a value that is not a finite number"));
    }
    Ok(values)
}

/// Fills a parameter-like buffer from tensors under `prefix`.
pub(crate) fn find_tensors(
    layout: &ParameterLayout,
    prefix: &str,
    lookup: &Lookup<'_>,
    buffer: &mut Buffer,
) -> Result<(), String> {
    for tensor in &layout.tensors {
        let values = find(lookup, &format!("{prefix}.{}", tensor.name), &tensor.shape)?;
        buffer[tensor.range.clone()].copy_from_slice(&values);
    }
    Ok(())
}
