//! What the people hear of the disk.

use super::event::Action;
use super::say;
use crate::messages::{Room, Severity, StorageState};

/// Says what is worse or better than it was said last.
pub(super) fn tell(before: Option<&StorageState>, now: &StorageState, actions: &mut Vec<Action>) {
    let free = now.free_text();
    let room_before = before.map_or(Room::Enough, |before| before.room);
    if now.room != room_before {
        match now.room {
            Room::Enough => say(actions, Severity::Info, format!("disk: {free} free again")),
            Room::Low => {
                let text = format!("disk: {free} free, report surveys or take them away");
                say(actions, Severity::Warning, text);
            }
            Room::TooLittle => {
                let needed_mb = now.survey_bytes / 1_000_000;
                let text = format!("disk: {free} free, no survey begins below {needed_mb} MB");
                say(actions, Severity::Error, text);
            }
        }
    }
    if now.has_log_failed && !before.is_some_and(|before| before.has_log_failed) {
        let text = "the log has failed: the flight goes on, but cannot be computed again";
        say(actions, Severity::Error, text.to_owned());
    } else if now.records_lost > 0 && before.is_none_or(|before| before.records_lost == 0) {
        let text = format!("{} entries of the log are lost", now.records_lost);
        say(actions, Severity::Error, text);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::time::Stamp;

    fn state(room: Room) -> StorageState {
        StorageState {
            at: Stamp::ZERO,
            room,
            free_bytes: Some(1_500_000_000),
            survey_bytes: 200_000_000,
            records_lost: 0,
            has_log_failed: false,
        }
    }

    fn told(before: Option<&StorageState>, now: &StorageState) -> Vec<(Severity, String)> {
        let mut actions = Vec::new();
        tell(before, now, &mut actions);
        let lines = actions.into_iter().filter_map(|action| match action {
            Action::Say(line) => Some((line.severity, line.text)),
            _ => None,
        });
        lines.collect()
    }

    #[test]
    fn a_disk_is_spoken_of_when_it_changes_and_not_before() {
        let (enough, low, full) = (state(Room::Enough), state(Room::Low), state(Room::TooLittle));
        assert!(told(None, &enough).is_empty());
        assert_eq!(told(None, &low)[0].0, Severity::Warning);
        assert!(told(Some(&low), &low).is_empty());
        let (severity, text) = told(Some(&low), &full).remove(0);
        assert_eq!(severity, Severity::Error);
        assert!(text.contains("1.5 GB") && text.contains("200 MB"), "{text}");
        assert_eq!(told(Some(&full), &enough)[0].0, Severity::Info);
    }

    #[test]
    fn lost_entries_and_a_failed_log_are_told_once() {
        let enough = state(Room::Enough);
        let losing = StorageState { records_lost: 7, ..enough };
        let failed = StorageState { records_lost: 90, has_log_failed: true, ..enough };
        assert!(told(Some(&enough), &losing)[0].1.starts_with("7 entries"));
        assert!(told(Some(&losing), &StorageState { records_lost: 8, ..enough }).is_empty());
        assert!(told(Some(&losing), &failed)[0].1.contains("has failed"));
        assert!(told(Some(&failed), &StorageState { records_lost: 99, ..failed }).is_empty());
    }
}
