//! The numbers of the scripted player: heights, lags and what each shortcoming costs in the choice of fingers.
//!
//! Found by playing the repertoire with a few values of each. The lags of the joints are measured, not set: see
//! `lags.rs`.

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
    /// Nearest that a waiting finger comes to a neighbour that plays, m.
    pub berth_m: f64,
    /// Where white keys are pressed, m toward the player from their middle.
    pub white_x_m: f64,
    /// Where black keys are pressed, m toward the player from their middle: near the front, so that a finger has not
    /// far to go from the white keys.
    pub black_x_m: f64,
    /// Control steps by which the rail sets off before the release of the note that it leaves.
    pub rail_lead: usize,
    /// Silent control steps that a finger needs between two different keys.
    pub change_steps: usize,
    /// The same from a white key to a black one or back: up, across the edge, down.
    pub black_change_steps: usize,
    /// Control steps in which a finger crosses the edge between white and black keys.
    pub cross_steps: usize,
    /// Control steps that a lifted finger stays over its old key, so that it clears fences before it moves aside.
    pub lift_steps: usize,
}

impl Default for ScriptedConfig {
    fn default() -> Self {
        Self {
            hover_m: 0.006,
            travel_m: 0.010,
            depth: 1.2,
            play_m: 0.020,
            separation_m: 0.021,
            berth_m: 0.0255,
            white_x_m: 0.028,
            black_x_m: 0.034,
            rail_lead: 2,
            change_steps: 3,
            black_change_steps: 6,
            cross_steps: 2,
            lift_steps: 1,
        }
    }
}
