//! The versions of the arm's firmware with which this driver was tried.

use super::driver::ArmVersion;

/// Major, minor and patch number: the last one with the protocol without keep-alive, and the one of
/// the emulator, which follows the maker's documents and client.
const TRIED: [(u16, u16, u16); 2] = [(1, 8, 5), (2, 4, 0)];

/// The versions that were tried, as text.
pub fn tried_firmware() -> String {
    TRIED.map(|(major, minor, patch)| format!("v{major}.{minor}.{patch}")).join(" and ")
}

/// The warning of an arm whose firmware differs from the tried ones in more than the patch number.
pub(crate) fn untried(version: &ArmVersion) -> Option<String> {
    let (major, minor, patch) = version.firmware;
    let was_tried = TRIED.iter().any(|tried| (tried.0, tried.1) == (major, minor));
    (!was_tried).then(|| {
        format!(
            "the arm's firmware v{major}.{minor}.{patch} was never tried with Étude (tried, on an emulator: {}): go through \
             docs/first-motion.md again with it, or install one of these in UFACTORY Studio",
            tried_firmware()
        )
    })
}
