//! Faults of links (delay, loss, cut cables) and faults of devices that are ordered for a time.
//!
//! [`FaultyFrames`] models a CAN bus, [`FaultyBytes`] a serial line or a TCP connection. Both are
//! given items and the time, and hand them out again as the [`FaultPlan`] says: the same plan and
//! the same calls always give the same result.

mod bytes;
mod frames;
mod kind;
mod order;
mod plan;

pub use bytes::FaultyBytes;
pub use frames::FaultyFrames;
pub use kind::{FaultError, FaultKind};
pub use order::{Faults, OrderedFault};
pub use plan::{FaultPlan, FaultPlanError};
