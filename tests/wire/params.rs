//! Parameter files against an autopilot that answers as PX4 or as ArduPilot: ten mistakes each.

use crate::support::{frame, heartbeat_frame, patiently};
use mavlink::MavlinkReader;
use mavlink::dialects::ardupilotmega::MavMessage;
use std::collections::BTreeMap;
use std::sync::{Arc, Mutex};
use stockpilot::link::params::{
    Comparison, Encoding, Kind, LiveAutopilot, LiveError, ParamFile, Problem, Value, compare,
};
use stockpilot::link::{Address, Guard};
use stockpilot::service::clock::Clock;
use tokio::net::UdpSocket;

const PX4_FILE: &str = include_str!("../../firmware-params/px4-indoor-vision.params");
const ARDUPILOT_FILE: &str = include_str!("../../firmware-params/ardupilot-indoor-vision.parm");

/// Number of a wire type, and the four bytes of the float field.
type Stored = (u8, [u8; 4]);
type Table = Arc<Mutex<BTreeMap<String, Stored>>>;

const INT8: u8 = 2;
const INT16: u8 = 4;
const INT32: u8 = 6;
const REAL32: u8 = 9;

/// An autopilot that knows nothing but parameters; its frames are built byte by byte.
struct Responder {
    address: Address,
    table: Table,
    task: tokio::task::JoinHandle<()>,
}

impl Responder {
    async fn new(autopilot: u8, base_mode: u8, table: BTreeMap<String, Stored>) -> Self {
        let socket = UdpSocket::bind("127.0.0.1:0").await.unwrap();
        let address = format!("udpout:{}", socket.local_addr().unwrap()).parse().unwrap();
        let table = Arc::new(Mutex::new(table));
        let task = tokio::spawn(answer(socket, [2, autopilot, base_mode, 3], Arc::clone(&table)));
        Self { address, table, task }
    }

    async fn find(&self) -> LiveAutopilot<Clock> {
        let found = LiveAutopilot::find(&self.address, Guard::unsigned(), Clock::real());
        patiently(found).await.unwrap()
    }
}

impl Drop for Responder {
    fn drop(&mut self) {
        self.task.abort();
    }
}

async fn answer(socket: UdpSocket, heartbeat: [u8; 4], table: Table) {
    let mut buffer = [0; 512];
    while let Ok((length, from)) = socket.recv_from(&mut buffer).await {
        let mut reader = MavlinkReader::new(&buffer[..length]);
        let Ok((_, message)) = reader.read_any_message::<MavMessage>() else { continue };
        let frame = match message {
            MavMessage::HEARTBEAT(_) => Some(heartbeat_frame((1, 1), heartbeat)),
            MavMessage::PARAM_REQUEST_READ(data) => {
                value_frame(data.param_id.to_str().unwrap(), &table)
            }
            MavMessage::PARAM_SET(data) => {
                let name = data.param_id.to_str().unwrap();
                if let Some(stored) = table.lock().unwrap().get_mut(name) {
                    stored.1 = data.param_value.to_le_bytes();
                }
                value_frame(name, &table)
            }
            _ => None,
        };
        if let Some(frame) = frame {
            socket.send_to(&frame, from).await.unwrap();
        }
    }
}

/// `PARAM_VALUE`: id 22, seed 220; nothing for an unknown name.
fn value_frame(name: &str, table: &Table) -> Option<Vec<u8>> {
    let (kind, field) = *table.lock().unwrap().get(name)?;
    let mut payload = field.to_vec();
    payload.extend([100, 0, 7, 0]);
    let mut id = [0; 16];
    id[..name.len()].copy_from_slice(name.as_bytes());
    payload.extend(id);
    payload.push(kind);
    Some(frame((1, 1), 22, 220, &payload))
}

fn bits(value: i32) -> [u8; 4] {
    value.to_le_bytes()
}

fn float(value: f32) -> [u8; 4] {
    value.to_le_bytes()
}

/// PX4 with the values of the shipped file.
fn px4() -> BTreeMap<String, Stored> {
    let file = ParamFile::parse(PX4_FILE).unwrap();
    let stored = |line: &stockpilot::link::params::Line| match line.kind {
        Some(Kind::Int32) => (INT32, bits(line.text.parse().unwrap())),
        Some(Kind::Real32) => (REAL32, float(line.text.parse().unwrap())),
        other => panic!("{other:?}"),
    };
    file.lines.iter().map(|line| (line.name.clone(), stored(line))).collect()
}

/// ArduCopter with the values of the shipped file, in its own types.
fn ardupilot() -> BTreeMap<String, Stored> {
    let file = ParamFile::parse(ARDUPILOT_FILE).unwrap();
    let kind = |name: &str| match name {
        "GUID_TIMEOUT" => REAL32,
        "GUID_OPTIONS" => INT32,
        "VISO_DELAY_MS" | "FS_OPTIONS" => INT16,
        _ => INT8,
    };
    let stored = |line: &stockpilot::link::params::Line| {
        (kind(&line.name), float(line.text.parse().unwrap()))
    };
    file.lines.iter().map(|line| (line.name.clone(), stored(line))).collect()
}

async fn wrong(file: &str, autopilot: &mut LiveAutopilot<Clock>) -> Vec<Comparison> {
    let file = ParamFile::parse(file).unwrap();
    let names: Vec<_> = file.lines.iter().map(|line| line.name.clone()).collect();
    let outcomes = patiently(autopilot.read(&names)).await.unwrap();
    let compared = file.lines.iter().zip(outcomes).map(|(line, o)| compare(line, o.found));
    compared.filter(|comparison| comparison.problem.is_some()).collect()
}

/// Each mistake alone is found, and nothing else; then all together.
async fn each_is_found(
    autopilot: u8,
    file: &str,
    good: BTreeMap<String, Stored>,
    mistakes: [(&str, Option<Stored>, Problem); 10],
) {
    let responder = Responder::new(autopilot, 0, good.clone()).await;
    let mut live = responder.find().await;
    assert_eq!(wrong(file, &mut live).await, []);
    let spoil = |table: &mut BTreeMap<String, Stored>, name: &str, to: Option<Stored>| {
        assert!(good.contains_key(name), "{name} is not in the file");
        match to {
            Some(stored) => table.insert(name.to_owned(), stored),
            None => table.remove(name),
        }
    };
    for (name, to, problem) in mistakes {
        *responder.table.lock().unwrap() = good.clone();
        spoil(&mut responder.table.lock().unwrap(), name, to);
        let found = wrong(file, &mut live).await;
        let [comparison] = found.as_slice() else { panic!("{name}: {found:?}") };
        assert_eq!((comparison.name.as_str(), comparison.problem), (name, Some(problem)));
    }
    for (name, to, _) in mistakes {
        spoil(&mut responder.table.lock().unwrap(), name, to);
    }
    let found: BTreeMap<_, _> =
        wrong(file, &mut live).await.into_iter().map(|c| (c.name, c.problem)).collect();
    let expected: BTreeMap<_, _> =
        mistakes.map(|(name, _, problem)| (name.to_owned(), Some(problem))).into();
    assert_eq!(found, expected);
}

#[tokio::test]
async fn each_of_ten_mistakes_on_px4_is_found() {
    let mistakes = [
        ("EKF2_EV_CTRL", Some((INT32, bits(0))), Problem::Differs),
        // A tool wrote 3.0 instead of the bits of 3.
        ("EKF2_HGT_REF", Some((INT32, float(3.0))), Problem::WrongEncoding),
        ("EKF2_EV_DELAY", Some((REAL32, float(0.0))), Problem::Differs),
        ("EKF2_GPS_CTRL", Some((INT32, bits(7))), Problem::Differs),
        // Another firmware keeps it as a float.
        ("EKF2_MAG_TYPE", Some((REAL32, float(5.0))), Problem::OtherType),
        ("SYS_HAS_GPS", Some((INT32, bits(1))), Problem::Differs),
        ("COM_OBL_RC_ACT", Some((INT32, bits(0))), Problem::Differs),
        ("COM_RC_IN_MODE", Some((INT32, bits(4))), Problem::Differs),
        ("COM_RC_OVERRIDE", Some((INT32, bits(1))), Problem::Differs),
        ("NAV_RCL_ACT", None, Problem::Unknown),
    ];
    each_is_found(12, PX4_FILE, px4(), mistakes).await;
}

#[tokio::test]
async fn each_of_ten_mistakes_on_ardupilot_is_found() {
    let mistakes = [
        ("VISO_TYPE", Some((INT8, float(0.0))), Problem::Differs),
        ("EK3_SRC1_POSXY", Some((INT8, float(3.0))), Problem::Differs),
        ("EK3_SRC1_POSZ", Some((INT8, float(1.0))), Problem::Differs),
        ("EK3_SRC1_YAW", Some((INT8, float(1.0))), Problem::Differs),
        ("GPS1_TYPE", None, Problem::Unknown),
        ("COMPASS_ENABLE", Some((INT8, float(1.0))), Problem::Differs),
        ("GUID_TIMEOUT", Some((REAL32, float(3.0))), Problem::Differs),
        ("FS_DR_ENABLE", Some((INT8, float(2.0))), Problem::Differs),
        ("FS_THR_ENABLE", Some((INT8, float(1.0))), Problem::Differs),
        ("VISO_DELAY_MS", Some((INT16, float(0.0))), Problem::Differs),
    ];
    each_is_found(3, ARDUPILOT_FILE, ardupilot(), mistakes).await;
}

/// ArduPilot's action on a critical battery does nothing without a threshold, and both are 0 by default.
#[tokio::test]
async fn a_threshold_that_is_the_owners_to_choose_is_demanded() {
    let file = ParamFile::parse(ARDUPILOT_FILE).unwrap();
    for (volt, mah, problem, told) in [
        (Some(0.0), Some(0.0), Some(Problem::NotChosen), Some(0.0)),
        (Some(14.0), Some(0.0), None, Some(14.0)),
        (Some(0.0), Some(500.0), None, Some(500.0)),
        (None, Some(0.0), Some(Problem::NotChosen), Some(0.0)),
        (None, None, Some(Problem::Unknown), None),
    ] {
        let mut table = ardupilot();
        for (name, value) in [("BATT_CRT_VOLT", volt), ("BATT_CRT_MAH", mah)] {
            table.extend(value.map(|value| (name.to_owned(), (REAL32, float(value)))));
        }
        let responder = Responder::new(3, 0, table).await;
        let mut live = responder.find().await;
        let comparisons = patiently(live.compare(&file)).await.unwrap();
        assert_eq!(comparisons.len(), file.lines.len() + 1);
        let demand = comparisons.last().unwrap();
        assert_eq!(demand.name, "BATT_CRT_VOLT or BATT_CRT_MAH");
        assert_eq!((demand.wanted.as_str(), demand.problem), ("above 0", problem));
        assert_eq!(demand.found.map(|(_, value)| value.as_f64()), told);
        assert!(comparisons.iter().rev().skip(1).all(|comparison| comparison.problem.is_none()));
    }
}

#[tokio::test]
async fn whole_numbers_are_written_as_each_autopilot_wants() {
    for (autopilot, name, kind, field) in
        [(12, "EKF2_EV_CTRL", INT32, bits(15)), (3, "VISO_TYPE", INT8, float(15.0))]
    {
        let table = BTreeMap::from([(name.to_owned(), (kind, [0; 4]))]);
        let responder = Responder::new(autopilot, 0, table).await;
        let mut live = responder.find().await;
        let kind = if autopilot == 12 { Kind::Int32 } else { Kind::Int8 };
        let encoding = if autopilot == 12 { Encoding::Bytewise } else { Encoding::CCast };
        assert_eq!(live.encoding(), encoding);
        let values = vec![(name.to_owned(), kind, Value::Whole(15))];
        let outcomes = patiently(live.write(values)).await.unwrap();
        assert_eq!(outcomes[0].found, Some((kind, Value::Whole(15))));
        assert_eq!(responder.table.lock().unwrap()[name].1, field);
    }
}

#[tokio::test]
async fn nothing_is_written_to_an_armed_autopilot() {
    let responder = Responder::new(12, 0x91, px4()).await;
    let mut live = responder.find().await;
    let values = vec![("EKF2_EV_CTRL".to_owned(), Kind::Int32, Value::Whole(0))];
    assert!(matches!(patiently(live.write(values)).await, Err(LiveError::Armed)));
    assert_eq!(responder.table.lock().unwrap()["EKF2_EV_CTRL"].1, bits(15));
}
