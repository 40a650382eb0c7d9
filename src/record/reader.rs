//! Reads logs, whole or cut.

use super::entry::{RecordedEvent, decode_event};
use super::topic::{ConfigTwin, LostTwin, Topic};
use crate::time::{Mono, Stamp};
use mcap::records::Record;
use mcap::sans_io::linear_reader::{LinearReadEvent, LinearReader, LinearReaderOptions};
use std::collections::BTreeMap;
use std::fmt;
use std::fs::File;
use std::io::{self, BufReader, Read};
use std::path::Path;

/// No record of ours is longer; a damaged length must not ask for the whole memory, bytes.
const MAX_RECORD_BYTES: usize = 512 * 1024 * 1024;

/// One thing in a log.
#[derive(Debug, Clone, PartialEq)]
pub enum LogItem {
    /// The head of the file.
    Config {
        /// Version of the program that wrote it.
        version: String,
        /// Build of that program.
        build: String,
        /// Its effective configuration, TOML.
        config_toml: String,
    },
    /// What the brain was told.
    Event {
        /// When.
        at: Stamp<Mono>,
        /// What.
        event: RecordedEvent,
    },
    /// What the brain gave out, or what was kept beside it ([`Topic::is_result`] tells which).
    Result {
        /// When.
        at: Stamp<Mono>,
        /// The channel.
        topic: Topic,
        /// The message as recorded.
        json: Vec<u8>,
    },
    /// Entries are missing here.
    Lost {
        /// How many.
        n_entries: u64,
    },
}

/// Walks through a log in the order of the file.
///
/// It stops without error where the file ends or is damaged; [`Self::is_complete`] tells which.
pub struct LogReader<R> {
    source: R,
    mcap: Box<LinearReader>,
    topics: BTreeMap<u16, Topic>,
    has_ended: bool,
    has_footer: bool,
    n_lost: u64,
    damage: Option<String>,
    /// Taken from the source so far, bytes.
    n_taken: u64,
    n_readable: u64,
    notes: BTreeMap<String, String>,
    began_at: Option<Stamp<Mono>>,
}

impl<R> fmt::Debug for LogReader<R> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("LogReader")
            .field("has_ended", &self.has_ended)
            .field("has_footer", &self.has_footer)
            .field("damage", &self.damage)
            .finish_non_exhaustive()
    }
}

impl LogReader<BufReader<File>> {
    /// Opens a log.
    ///
    /// # Errors
    /// The file cannot be opened.
    pub fn open(path: &Path) -> io::Result<Self> {
        Ok(Self::new(BufReader::new(File::open(path)?)))
    }
}

impl<R: Read> LogReader<R> {
    /// Reads a log from any source of bytes.
    #[must_use]
    pub fn new(source: R) -> Self {
        let options = LinearReaderOptions::default()
            .with_prevalidate_chunk_crcs(true)
            // What lies outside the chunks, lengths and kinds of records, can hide a chunk.
            .with_validate_data_section_crc(true)
            .with_validate_summary_section_crc(true)
            .with_record_length_limit(MAX_RECORD_BYTES);
        Self {
            source,
            mcap: Box::new(LinearReader::new_with_options(options)),
            topics: BTreeMap::new(),
            has_ended: false,
            has_footer: false,
            n_lost: 0,
            damage: None,
            n_taken: 0,
            n_readable: 0,
            notes: BTreeMap::new(),
            began_at: None,
        }
    }

    /// What was noted in the file so far: civil time at its start, known once the first item was read; which
    /// LiDAR answers, further on.
    #[must_use]
    pub const fn notes(&self) -> &BTreeMap<String, String> {
        &self.notes
    }

    /// When the log began; known once the first item was read.
    #[must_use]
    pub const fn began_at(&self) -> Option<Stamp<Mono>> {
        self.began_at
    }

    /// True once everything was read, the file has its proper end, and nothing is missing in it.
    #[must_use]
    pub const fn is_complete(&self) -> bool {
        self.has_ended && self.has_footer && self.damage.is_none() && self.n_lost == 0
    }

    /// True if the file says that entries are missing in what was read so far.
    #[must_use]
    pub const fn has_gaps(&self) -> bool {
        self.n_lost > 0
    }

    /// How far into the file the last item was found, bytes: what lies behind it holds none, is damaged,
    /// or was not read yet.
    #[must_use]
    pub const fn readable_bytes(&self) -> u64 {
        self.n_readable
    }

    /// Why reading stopped early, if it did.
    #[must_use]
    pub fn damage(&self) -> Option<&str> {
        self.damage.as_deref()
    }

    /// The next item that a replay knows; other channels are passed over.
    fn advance(&mut self) -> Result<Option<LogItem>, String> {
        loop {
            let record = match self.mcap.next_event() {
                None => return Ok(None),
                Some(Err(error)) => return Err(error.to_string()),
                Some(Ok(LinearReadEvent::ReadRequest(n_bytes))) => {
                    // A damaged length asks for much; what is not there is not waited for.
                    let room = self.mcap.insert(n_bytes.min(1 << 20));
                    let n_read = self.source.read(room).map_err(|error| error.to_string())?;
                    self.mcap.notify_read(n_read);
                    self.n_taken += n_read as u64;
                    continue;
                }
                Some(Ok(LinearReadEvent::Record { data, opcode })) => {
                    mcap::parse_record(opcode, data)
                        .map_err(|error| error.to_string())?
                        .into_owned()
                }
            };
            if let Some(item) = self.item_of(record)? {
                return Ok(Some(item));
            }
        }
    }

    fn item_of(&mut self, record: Record<'_>) -> Result<Option<LogItem>, String> {
        match record {
            Record::Channel(channel) => {
                if let Some(topic) = Topic::from_name(&channel.topic) {
                    self.topics.insert(channel.id, topic);
                }
                Ok(None)
            }
            Record::Message { header, data } => match self.topics.get(&header.channel_id) {
                Some(topic) => {
                    let at = Stamp::from_nanos(i64::try_from(header.log_time).unwrap_or(i64::MAX));
                    self.began_at.get_or_insert(at);
                    read_message(*topic, at, &data).map(Some)
                }
                None => Ok(None),
            },
            Record::Metadata(metadata) => {
                self.notes.extend(metadata.metadata);
                Ok(None)
            }
            Record::Footer(_) => {
                self.has_footer = true;
                Ok(None)
            }
            _ => Ok(None),
        }
    }
}

impl<R: Read> Iterator for LogReader<R> {
    type Item = LogItem;

    fn next(&mut self) -> Option<LogItem> {
        if self.has_ended {
            return None;
        }
        match self.advance() {
            Ok(Some(item)) => {
                self.n_readable = self.n_taken;
                if let LogItem::Lost { n_entries } = item {
                    self.n_lost = self.n_lost.saturating_add(n_entries);
                }
                Some(item)
            }
            Ok(None) => {
                self.has_ended = true;
                None
            }
            Err(damage) => {
                self.has_ended = true;
                self.damage = Some(damage);
                None
            }
        }
    }
}

fn read_message(topic: Topic, at: Stamp<Mono>, json: &[u8]) -> Result<LogItem, String> {
    let bad = |error: serde_json::Error| format!("bad message on {}: {error}", topic.name());
    if let Some(event) = decode_event(topic, json) {
        return Ok(LogItem::Event { at, event: event.map_err(bad)? });
    }
    match topic {
        Topic::Config => {
            let ConfigTwin { version, build, config_toml } =
                serde_json::from_slice(json).map_err(bad)?;
            Ok(LogItem::Config { version, build, config_toml })
        }
        Topic::Lost => {
            let LostTwin { n_entries } = serde_json::from_slice(json).map_err(bad)?;
            Ok(LogItem::Lost { n_entries })
        }
        _ => Ok(LogItem::Result { at, topic, json: json.to_vec() }),
    }
}
