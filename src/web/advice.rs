//! Warnings that say what to do, and what speaks against accepting a flight.

use super::state::{Level, State, Volume, Warning};
use crate::mission::Phase;

/// From this share of refused beams on there is dust in the air.
pub(super) const DUSTY_RATIO: f64 = 0.05;
/// Fewer returns than this and the material is too dark, too far or the window dirty.
const FEW_RETURNS_RATIO: f64 = 0.5;
/// A larger share of a volume that nobody saw is remarked.
const MUCH_UNSEEN_RATIO: f64 = 0.02;

/// What is wrong, the worst first.
pub(super) fn warnings(state: &State, phase: Phase) -> Vec<Warning> {
    if !state.is_brain_alive {
        return vec![warning(
            Level::Bad,
            "stockpilot's brain is silent",
            "take over with the mode switch; the autopilot's own failsafe acts by itself",
        )];
    }
    let mut found: Vec<Warning> = Vec::new();
    found.extend(of_position(state, phase));
    found.extend(of_link(state));
    found.extend(of_battery(state, phase));
    found.extend(of_lidar(state, phase));
    found.extend(of_computer(state));
    found.extend(of_ground(state));
    found.sort_by_key(|warning| warning.level != Level::Bad);
    found
}

fn warning(level: Level, what: impl Into<String>, todo: impl Into<String>) -> Warning {
    Warning { level, what: what.into(), todo: todo.into() }
}

fn is_flying(phase: Phase) -> bool {
    !matches!(phase, Phase::Idle | Phase::Preflight)
}

fn of_position(state: &State, phase: Phase) -> Option<Warning> {
    let [seen, used] = state.fix.markers;
    match state.fix.level {
        Level::Bad if is_flying(phase) => Some(warning(
            Level::Bad,
            format!("position lost, {seen} markers in view"),
            "it holds, then lands where it is: keep clear below, light the markers",
        )),
        Level::Bad => Some(warning(
            Level::Degraded,
            format!("no position yet, {seen} markers in view, {used} of them usable"),
            "turn the camera to the markers, light them, and check the marker map",
        )),
        Level::Degraded => Some(warning(
            Level::Degraded,
            format!("position uncertain, {used} of {seen} markers usable"),
            "nothing is mapped while it lasts; hang or light one more marker here",
        )),
        Level::Good | Level::Unknown => None,
    }
}

fn of_link(state: &State) -> Option<Warning> {
    let link = &state.link;
    let off_m = link.disagreement_m.filter(|off_m| *off_m > 0.25);
    match link.level {
        Level::Bad => Some(warning(
            Level::Bad,
            "the autopilot is silent or in a failsafe",
            "take over with the sticks; check cable, port and speed of the link",
        )),
        Level::Degraded => Some(warning(
            Level::Degraded,
            format!("{:.1} % of the autopilot's messages are lost", 100.0 * link.missed_ratio),
            "raise the speed of the link or lower the streams",
        )),
        _ => off_m.map(|off_m| {
            warning(
                Level::Degraded,
                format!("the autopilot believes to be {:.0} cm elsewhere", 100.0 * off_m),
                "beyond 50 cm it lands: does the autopilot fuse the position from here?",
            )
        }),
    }
}

fn of_battery(state: &State, phase: Phase) -> Option<Warning> {
    let percent = state.battery.percent.unwrap_or(0.0);
    let todo = if is_flying(phase) {
        "it returns by itself: let it"
    } else {
        "change the battery before the next flight"
    };
    match state.battery.level {
        Level::Bad => Some(warning(Level::Bad, format!("battery at {percent:.0} %"), todo)),
        Level::Degraded => Some(warning(
            Level::Degraded,
            format!(
                "battery at {percent:.0} %, it turns home at {:.0} %",
                state.battery.turns_home_at_percent
            ),
            "the survey may end early: have a fresh battery ready",
        )),
        Level::Good | Level::Unknown => None,
    }
}

fn of_lidar(state: &State, phase: Phase) -> Option<Warning> {
    let lidar = &state.lidar;
    if lidar.level == Level::Bad {
        let todo = if is_flying(phase) {
            "it holds, and returns after 10 s"
        } else {
            "check its plug, its power and the port in the configuration"
        };
        return Some(warning(Level::Bad, format!("LiDAR: {}", lidar.health), todo));
    }
    if let Some(dust) = lidar.dust_ratio.filter(|ratio| *ratio > DUSTY_RATIO) {
        return Some(warning(
            Level::Degraded,
            format!("{:.0} % of the hits are dust or things that move", 100.0 * dust),
            "wait some minutes until the dust has settled, and stop machines",
        ));
    }
    let few = lidar.return_ratio.filter(|ratio| *ratio < FEW_RETURNS_RATIO)?;
    (phase == Phase::Survey).then(|| {
        warning(
            Level::Degraded,
            format!("only {:.0} % of the beams come back", 100.0 * few),
            "the material is dark or far: fly lower, clean the window",
        )
    })
}

fn of_computer(state: &State) -> Option<Warning> {
    let computer = &state.computer;
    if computer.records_lost > 0 {
        return Some(warning(
            Level::Bad,
            format!("{} entries of the log are lost", computer.records_lost),
            "the flight goes on but cannot be re-computed: free the disk before the next one",
        ));
    }
    if let Some(free) = computer.free_bytes.filter(|_| computer.is_disk_short) {
        return Some(warning(
            Level::Degraded,
            format!("{} MB left on the disk", free / 1_000_000),
            "report surveys or take them away: reported ones are deleted for room",
        ));
    }
    (!computer.is_clock_known && state.link.level != Level::Unknown).then(|| {
        warning(
            Level::Degraded,
            "the autopilot's clock is not known",
            "wait some seconds; if it stays, let the autopilot answer TIMESYNC",
        )
    })
}

fn of_ground(state: &State) -> Option<Warning> {
    let moved = state.volumes.iter().find(|volume| volume.shares[3] > 0.001)?;
    Some(warning(
        Level::Degraded,
        format!("something moved in {}: {:.1} % of it is old", moved.name, 100.0 * moved.shares[3]),
        "stop machines and people there; it is measured again when the way leads over it",
    ))
}

/// What speaks against accepting a flight.
pub(super) fn remarks(is_complete: bool, volumes: &[Volume], target_percent: f64) -> Vec<String> {
    let mut remarks = Vec::new();
    if !is_complete {
        remarks.push("the survey was cut short".to_owned());
    }
    for volume in volumes {
        let [_, _, unseen, disturbed] = volume.shares;
        let name = &volume.name;
        if unseen > MUCH_UNSEEN_RATIO {
            remarks.push(format!("{name}: {:.0} % of the volume was not seen", 100.0 * unseen));
        }
        if disturbed > 0.001 {
            remarks.push(format!("{name}: {:.1} % moved during the flight", 100.0 * disturbed));
        }
        match volume.expanded_percent {
            Some(percent) if percent > target_percent => remarks.push(format!(
                "{name}: U is {}, wished for were {target_percent:.1} %",
                share_of_volume(percent)
            )),
            _ => {}
        }
    }
    remarks
}

/// An uncertainty in words, without false digits.
fn share_of_volume(percent: f64) -> String {
    match percent {
        ..10.0 => format!("{percent:.1} % of the volume"),
        ..=100.0 => format!("{percent:.0} % of the volume"),
        _ => "more than the volume itself".to_owned(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn volume(shares: [f64; 4], expanded_percent: f64) -> Volume {
        Volume {
            name: "salt".to_owned(),
            volume_m3: 100.0,
            expanded_m3: expanded_percent,
            stated_m3: ["100".to_owned(), "1".to_owned()],
            expanded_percent: Some(expanded_percent),
            stated_t: None,
            shares,
            trend: 0,
            sources: Vec::new(),
        }
    }

    #[test]
    fn a_good_flight_has_no_remark_and_each_fault_has_one() {
        assert!(remarks(true, &[volume([0.97, 0.03, 0.0, 0.0], 1.4)], 2.0).is_empty());
        let of = |complete, shares, percent| remarks(complete, &[volume(shares, percent)], 2.0);
        assert_eq!(of(false, [1.0, 0.0, 0.0, 0.0], 1.4), ["the survey was cut short"]);
        assert_eq!(of(true, [0.9, 0.0, 0.1, 0.0], 1.4), ["salt: 10 % of the volume was not seen"]);
        let wide = ["salt: U is 2.6 % of the volume, wished for were 2.0 %"];
        assert_eq!(of(true, [1.0, 0.0, 0.0, 0.0], 2.6), wide);
        let wider = ["salt: U is 80 % of the volume, wished for were 2.0 %"];
        assert_eq!(of(true, [1.0, 0.0, 0.0, 0.0], 80.46), wider);
        let widest = ["salt: U is more than the volume itself, wished for were 2.0 %"];
        assert_eq!(of(true, [1.0, 0.0, 0.0, 0.0], 1085.1), widest);
    }
}
