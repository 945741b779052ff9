//! The limits of a set-point.

/// Longest time that stopping from full speed may take, s.
const MAX_STOP_SECS: f64 = 10.0;

/// The limits of a set-point. Rad and s; m and s for the rail.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct AxisLimits {
    /// Smallest and largest position.
    pub position: [f64; 2],
    /// Largest speed.
    pub velocity: f64,
    /// Largest acceleration, either way.
    pub acceleration: f64,
    /// Largest change of acceleration per second.
    pub jerk: f64,
}

impl AxisLimits {
    /// Checks that there is a range, and that stopping does not take too long. Speed, acceleration
    /// and jerk have ranges in the rig's settings.
    ///
    /// # Errors
    /// Names the first that is not.
    pub fn check(&self) -> Result<(), String> {
        let [low, high] = self.position;
        if !(low.is_finite() && high.is_finite() && low < high) {
            return Err(format!("the position range {low} … {high} is empty"));
        }
        let stopping_secs = self.velocity / self.acceleration + self.acceleration / self.jerk;
        if stopping_secs > MAX_STOP_SECS {
            return Err(format!("stopping from full speed would take {stopping_secs:.0} s"));
        }
        Ok(())
    }
}
