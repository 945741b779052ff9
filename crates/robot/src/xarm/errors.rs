//! The controller's error codes, and what the operator does about each.
//!
//! Numbers and meanings are those of UFACTORY's manual and of `xarm/core/config/x_code.py` in
//! xArm-Python-SDK; the remedies are our advice.

const RELEASE: &str = "make sure that nobody and nothing is in the way, release the button, then start again";
const REBOOT: &str = "switch the control box off and on; if it comes back, call UFACTORY's support";
const SUPPORT: &str = "write the code down and call UFACTORY's support";
const SERVO: &str = "read the joint's servo code, switch the control box off and on, then start again";
const CABLES: &str = "switch off, check the cables and plugs, switch on, then start again";
const UNUSED: &str =
    "nothing is expected there: unplug it, or switch it off in UFACTORY Studio, then start again";
const NEARER: &str = "bring the arm home by hand or with UFACTORY Studio, then start again";
const SLOWER: &str = "slow the motion down or smooth the targets, then start again";
const OURS: &str =
    "start again; if it comes back, keep the recording and report it: the driver sent something wrong";
const CLEAR: &str =
    "clear what the arm touched, check payload and collision sensitivity in the config, then start again";
const FILES: &str = "restore the controller's configuration in UFACTORY Studio, then switch it off and on";

/// Explains an error of the controller: its number, what has happened, and what to do next.
pub fn controller_error(code: u8) -> String {
    let row = ERRORS.iter().find(|row| row.0 == code);
    let (_, meaning, remedy) = row.unwrap_or(&(0, UNLISTED, LOOK_UP));
    format!("{code} ({meaning}): {remedy}")
}

const UNLISTED: &str = "not listed";
const LOOK_UP: &str = "look it up in UFACTORY's manual, clear the error in UFACTORY Studio, then start again";
const ERRORS: &[(u8, &str, &str)] = &[
    (1, "the emergency button is pressed", RELEASE),
    (2, "the emergency input is open", RELEASE),
    (3, "the three-position switch stops the arm", RELEASE),
    (10, "a servo fails", SERVO),
    (11, "the servo of joint 1 fails", SERVO),
    (12, "the servo of joint 2 fails", SERVO),
    (13, "the servo of joint 3 fails", SERVO),
    (14, "the servo of joint 4 fails", SERVO),
    (15, "the servo of joint 5 fails", SERVO),
    (16, "the servo of joint 6 fails", SERVO),
    (17, "the servo of joint 7 fails", SERVO),
    (18, "the force sensor does not answer", UNUSED),
    (19, "the end effector does not answer", UNUSED),
    (21, "no joints reach the pose", NEARER),
    (22, "the arm would hit itself", NEARER),
    (23, "a joint is at its limit", NEARER),
    (24, "a joint would be too fast", SLOWER),
    (25, "the motion cannot be planned", NEARER),
    (26, "the controller's real-time system fails", REBOOT),
    (27, "a command was answered wrongly inside the controller", REBOOT),
    (28, "the end module does not answer", CABLES),
    (30, "the measured speed is beyond the limit", SLOWER),
    (31, "a collision, or a current that looks like one", CLEAR),
    (32, "an arc cannot be computed", OURS),
    (33, "the control box's inputs and outputs fail", REBOOT),
    (34, "recording a path took too long", "record a shorter path"),
    (35, "the arm is outside its safety boundary", NEARER),
    (36, "too many delayed commands", OURS),
    (
        37,
        "the arm moved oddly while guided by hand",
        "guide it more slowly, check the payload, then start again",
    ),
    (38, "a joint angle is not possible", SERVO),
    (39, "the power board does not answer", CABLES),
    (40, "no joint path is free of errors", NEARER),
    (41, "the friction file is damaged", FILES),
    (42, "the calibration file is damaged", FILES),
    (43, "the dynamics cannot be loaded", FILES),
    (44, "the serial numbers of arm and control box do not match", SUPPORT),
    (50, "the force sensor fails", UNUSED),
    (51, "the force sensor fails", UNUSED),
    (52, "the force sensor fails", UNUSED),
    (53, "the force sensor fails", UNUSED),
    (60, "the tool would be too fast in servo mode", SLOWER),
    (110, "the board in the arm's base does not answer", CABLES),
    (111, "the external RS-485 device does not answer", UNUSED),
];

#[cfg(test)]
mod tests {
    use super::*;

    /// The codes of `ControllerErrorCodeMap` in the official SDK (`x_code.py`), in its order.
    const LISTED: &str = "1 2 3 10 11 12 13 14 15 16 17 18 19 21 22 23 24 25 26 27 28 30 31 32 33 34 35 36 37 38 \
        39 40 41 42 43 44 50 51 52 53 60 110 111";

    #[test]
    fn every_listed_code_is_explained_and_no_other() {
        let listed: Vec<u8> = LISTED.split_whitespace().map(|code| code.parse().unwrap()).collect();
        for code in 0..=u8::MAX {
            let said = controller_error(code);
            assert!(said.starts_with(&format!("{code} (")), "{said}");
            assert_eq!(!said.contains(UNLISTED), listed.contains(&code), "{said}");
        }
    }
}
