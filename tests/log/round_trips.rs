//! Every event comes back to the last bit.

use crate::support::{event, events_of, write_log};
use proptest::collection::vec;
use proptest::prelude::{ProptestConfig, prop_assert_eq, proptest};
use stockpilot::record::{LogItem, LogReader};

proptest! {
    #![proptest_config(ProptestConfig::with_cases(64))]

    #[test]
    fn events_come_back_exactly_and_in_order(events in vec(event(), 1..60)) {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("flight.mcap");
        let steps: Vec<_> = events.iter().map(|event| (event.clone(), vec![])).collect();
        let stats = write_log(&path, &steps);
        prop_assert_eq!(stats.written, events.len() as u64);
        let (read, is_complete) = events_of(&std::fs::read(&path).unwrap());
        // Debug prints negative zero and every digit, which equality alone would pass over.
        prop_assert_eq!(format!("{read:?}"), format!("{events:?}"));
        prop_assert_eq!(read, events);
        prop_assert_eq!(is_complete, true);
    }
}

#[test]
fn the_configuration_stands_first() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("flight.mcap");
    write_log(&path, &[]);
    let mut reader = LogReader::open(&path).unwrap();
    let Some(LogItem::Config { config_toml, version, .. }) = reader.next() else {
        unreachable!("a log begins with its configuration")
    };
    assert_eq!(config_toml, "answer = 42\n");
    assert_eq!(version, env!("CARGO_PKG_VERSION"));
    assert!(reader.next().is_none());
    assert!(reader.is_complete());
}

#[test]
fn an_existing_file_is_never_overwritten() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("flight.mcap");
    std::fs::write(&path, "precious").unwrap();
    let header = stockpilot::record::LogHeader::default();
    assert!(stockpilot::record::Recorder::create(&path, &header).is_err());
    assert_eq!(std::fs::read_to_string(&path).unwrap(), "precious");
}
