//! The numbers of the scripted player: heights, lags and what each shortcoming costs in the choice of fingers.
//!
//! The lags were measured in the nominal world by stepping one target and reading the physics steps at which keys
//! cross their threshold; `cargo run --release -p etude-task --example scripted -- lag` prints the measurement again.

use serde::{Deserialize, Serialize};

/// How the script plays. Lengths in metres, times in seconds or control steps.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct ScriptedConfig {
    /// Clearance of a waiting fingertip over its key, m: above the fences, low enough for a quick strike.
    pub hover_m: f64,
    /// Clearance over black keys while a finger goes from or to one, m.
    pub travel_m: f64,
    /// How deep a strike aims, as a fraction of the key's travel. Beyond one, because the reference slows down toward
    /// its end and the springs of key and joints take up some of it.
    pub depth: f64,
    /// How far a fingertip may be to either side of the place under its unturned root, m.
    pub play_m: f64,
    /// Nearest that two neighbouring fingers may press at once, m: the width of a finger's links.
    pub separation_m: f64,
    /// Where white keys are pressed, m toward the player from their middle.
    pub white_x_m: f64,
    /// Control steps from a strike's target to the first step in which the key sounds.
    pub strike_lead: usize,
    /// The same for a strike that follows the release of the same key at once.
    pub restrike_lead: usize,
    /// Control steps from the target that lifts a finger to the first step in which the key no longer sounds.
    pub release_lead: usize,
    /// Control steps by which the rail sets off before the release of the note that it leaves.
    pub rail_lead: usize,
    /// Silent control steps that a finger needs between two different keys.
    pub change_steps: usize,
    /// Control steps that a lifted finger stays over its old key, so that it clears fences before it moves aside.
    pub lift_steps: usize,
    /// How far ahead a finger looks along the rail's path, s: the mean lag of a finger joint behind its target.
    pub follow_secs: f64,
}

impl Default for ScriptedConfig {
    fn default() -> Self {
        Self {
            hover_m: 0.006,
            travel_m: 0.006,
            depth: 1.2,
            play_m: 0.016,
            separation_m: 0.021,
            white_x_m: 0.030,
            strike_lead: 2,
            restrike_lead: 1,
            release_lead: 1,
            rail_lead: 2,
            change_steps: 3,
            lift_steps: 2,
            follow_secs: 0.125,
        }
    }
}
