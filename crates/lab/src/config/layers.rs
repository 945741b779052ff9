//! The layers of a configuration as TOML tables.

use anyhow::anyhow;
use etude_music::did_you_mean;

/// The one of these `settings` that a mistyped path may mean: one that ends with its name, whatever
/// table it is in, or one that is written much like it.
pub(super) fn meant(path: &str, settings: &toml::Table) -> String {
    let all = paths(settings, "");
    let name = path.rsplit('.').next().unwrap_or(path);
    let elsewhere: Vec<&str> =
        all.iter().map(String::as_str).filter(|other| other.rsplit('.').next() == Some(name)).collect();
    if elsewhere.is_empty() {
        let table = |path: &str| path.rfind('.').map_or(0, |at| at);
        let beside =
            all.iter().map(String::as_str).filter(|other| other[..table(other)] == path[..table(path)]);
        let names = beside.map(|other| other.rsplit('.').next().unwrap_or(other));
        return did_you_mean(name, names);
    }
    format!(" (did you mean {}?)", elsewhere.join(", "))
}

/// The dotted paths of all settings in `table`, and of the tables in it.
fn paths(table: &toml::Table, above: &str) -> Vec<String> {
    table
        .iter()
        .flat_map(|(name, value)| match value {
            toml::Value::Table(inner) => {
                let mut all = paths(inner, &format!("{above}{name}."));
                all.push(format!("{above}{name}"));
                all
            }
            _ => vec![format!("{above}{name}")],
        })
        .collect()
}

pub(super) fn parse(text: &str, origin: &str) -> anyhow::Result<toml::Table> {
    text.parse().map_err(|error| anyhow!("{origin} is not valid TOML: {}", toml_error(text, &error)))
}

/// What is wrong with a TOML `text`, and in which line.
pub fn toml_error(text: &str, error: &toml::de::Error) -> String {
    let before = error.span().and_then(|span| text.get(..span.start));
    let line =
        before.map_or_else(String::new, |before| format!("line {}: ", before.matches('\n').count() + 1));
    line + error.message()
}

/// Tables whose keys are paths of physical parameters.
const BY_PATH: &[&str] = &["task.physics", "task.randomisation.widths"];

/// The table with `value` at a dotted `path`. A value that is not TOML is taken as a string, so
/// that `task.stage.side=right` needs no quotes. Physical parameters keep the rest of their path as
/// one key.
pub(super) fn override_table(path: &str, value: &str) -> toml::Table {
    let parsed = format!("v = {value}").parse::<toml::Table>().ok().and_then(|mut t| t.remove("v"));
    let mut value = parsed.unwrap_or_else(|| toml::Value::String(value.to_string()));
    // Steps are integers: `2e6` is accepted for `2_000_000`.
    if let toml::Value::Float(whole) = value
        && whole.fract() == 0.0
        && (0.0..=9e15).contains(&whole)
    {
        value = toml::Value::Integer(whole as i64);
    }
    // Physical numbers are real: `1` is accepted for `1.0`.
    if let (Some("physics" | "reward"), toml::Value::Integer(whole)) = (path.split('.').nth(1), &value) {
        value = toml::Value::Float(*whole as f64);
    }
    let by_path = |table: &&'static str| Some((*table, path.strip_prefix(table)?.strip_prefix('.')?));
    let split = BY_PATH.iter().find_map(by_path).or_else(|| path.rsplit_once('.'));
    let (tables, key) = split.map_or((None, path), |(tables, key)| (Some(tables), key));
    let table = toml::Table::from_iter([(key.to_string(), value)]);
    tables
        .into_iter()
        .flat_map(|tables| tables.rsplit('.'))
        .fold(table, |inner, name| toml::Table::from_iter([(name.to_string(), toml::Value::Table(inner))]))
}

pub(super) fn merge(base: &mut toml::Table, over: toml::Table) {
    for (key, value) in over {
        match (base.get_mut(&key), value) {
            (Some(toml::Value::Table(base)), toml::Value::Table(over)) => merge(base, over),
            (_, value) => {
                base.insert(key, value);
            }
        }
    }
}
