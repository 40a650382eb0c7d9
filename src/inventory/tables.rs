//! The tables, and how those of earlier programs become these.

use super::InventoryError;
use rusqlite::{Connection, TransactionBehavior};

/// The form of the tables, kept in the file's `user_version`.
const VERSION: i64 = 4;

const SURVEY: &str = "
    CREATE TABLE survey (
        id TEXT PRIMARY KEY,
        hall_id TEXT NOT NULL REFERENCES hall(id),
        identity TEXT UNIQUE,
        log_sha256 TEXT NOT NULL,
        number INTEGER,
        log_path TEXT NOT NULL,
        started_utc TEXT,
        newest_at_ns INTEGER,
        version TEXT NOT NULL,
        build TEXT NOT NULL,
        config_toml TEXT NOT NULL,
        independent TEXT NOT NULL,
        decision TEXT,
        UNIQUE (log_sha256, number)
    ) STRICT;
";

const REPLACED: &str = "
    CREATE TABLE replaced (
        survey_id TEXT NOT NULL REFERENCES survey(id),
        log_sha256 TEXT NOT NULL,
        build TEXT NOT NULL,
        config_toml TEXT NOT NULL,
        accounts_json TEXT NOT NULL
    ) STRICT;
";

const OTHERS: &str = "
    CREATE TABLE hall (
        id TEXT PRIMARY KEY,
        name TEXT NOT NULL UNIQUE
    ) STRICT;
    CREATE TABLE bay (
        id TEXT PRIMARY KEY,
        hall_id TEXT NOT NULL REFERENCES hall(id),
        name TEXT NOT NULL,
        UNIQUE (hall_id, name)
    ) STRICT;
    CREATE TABLE volume (
        survey_id TEXT NOT NULL REFERENCES survey(id),
        bay_id TEXT NOT NULL REFERENCES bay(id),
        position INTEGER NOT NULL,
        volume_m3 REAL NOT NULL,
        sigma_m3 REAL NOT NULL,
        mass_t REAL,
        mass_sigma_t REAL,
        account_json TEXT NOT NULL,
        PRIMARY KEY (survey_id, bay_id)
    ) STRICT;
";

const SET_ASIDE: &str = "ALTER TABLE survey RENAME TO survey_old;";

/// Version 1 knew the last survey of each log, without its number, and nothing of independent errors.
const FROM_1: &str = "
    INSERT INTO survey
        SELECT id, hall_id, NULL, log_sha256, NULL, log_path, started_utc, NULL, version, build, config_toml, '',
            NULL
        FROM survey_old ORDER BY rowid;
    DROP TABLE survey_old;
";

/// Version 2 took a survey that came from version 1 for the first of its log, so its firsts may be any.
const FROM_2: &str = "
    INSERT INTO survey
        SELECT id, hall_id, NULL, log_sha256, NULLIF(number, 1), log_path, started_utc, NULL, version, build,
            config_toml, independent, NULL
        FROM survey_old ORDER BY rowid;
    DROP TABLE survey_old;
";

/// Version 3 had no decisions at first.
const FROM_3: &str = "
    INSERT INTO survey
        SELECT id, hall_id, identity, log_sha256, number, log_path, started_utc, newest_at_ns, version, build,
            config_toml, independent, NULL
        FROM survey_old ORDER BY rowid;
    DROP TABLE survey_old;
";

/// Makes the tables, or brings them to this program's form, in one transaction.
///
/// # Errors
/// A file that cannot be written, or is of a newer program.
pub(super) fn bring_up(database: &mut Connection) -> Result<(), InventoryError> {
    // A table that others refer to is put into another one's place: they refer to its name.
    database.pragma_update(None, "foreign_keys", false)?;
    database.pragma_update(None, "legacy_alter_table", true)?;
    let begun = database.transaction_with_behavior(TransactionBehavior::Immediate)?;
    let found: i64 = begun.pragma_query_value(None, "user_version", |row| row.get(0))?;
    match found {
        0 => begun.execute_batch(&[SURVEY, OTHERS, REPLACED].concat())?,
        1 => begun.execute_batch(&[SET_ASIDE, SURVEY, FROM_1, REPLACED].concat())?,
        2 => begun.execute_batch(&[SET_ASIDE, SURVEY, FROM_2, REPLACED].concat())?,
        3 if !has_decisions(&begun)? => {
            begun.execute_batch(&[SET_ASIDE, SURVEY, FROM_3].concat())?
        }
        3 | VERSION => {}
        _ => return Err(InventoryError::Version { found, known: VERSION }),
    }
    if found != VERSION {
        begun.pragma_update(None, "user_version", VERSION)?;
    }
    begun.commit()?;
    database.pragma_update(None, "legacy_alter_table", false)?;
    Ok(database.pragma_update(None, "foreign_keys", true)?)
}

fn has_decisions(database: &Connection) -> Result<bool, InventoryError> {
    let sql = "SELECT COUNT(*) FROM pragma_table_info('survey') WHERE name = 'decision'";
    Ok(database.query_row(sql, [], |row| row.get::<_, i64>(0))? > 0)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The tables as the first program made them, with one survey.
    const OLD: &str = "
        CREATE TABLE hall (id TEXT PRIMARY KEY, name TEXT NOT NULL UNIQUE) STRICT;
        CREATE TABLE survey (
            id TEXT PRIMARY KEY,
            hall_id TEXT NOT NULL REFERENCES hall(id),
            log_sha256 TEXT NOT NULL UNIQUE,
            log_path TEXT NOT NULL,
            started_utc TEXT,
            version TEXT NOT NULL,
            build TEXT NOT NULL,
            config_toml TEXT NOT NULL
        ) STRICT;
        CREATE TABLE bay (id TEXT PRIMARY KEY, hall_id TEXT NOT NULL REFERENCES hall(id),
            name TEXT NOT NULL, UNIQUE (hall_id, name)) STRICT;
        CREATE TABLE volume (
            survey_id TEXT NOT NULL REFERENCES survey(id),
            bay_id TEXT NOT NULL REFERENCES bay(id),
            position INTEGER NOT NULL,
            volume_m3 REAL NOT NULL,
            sigma_m3 REAL NOT NULL,
            mass_t REAL,
            mass_sigma_t REAL,
            account_json TEXT NOT NULL,
            PRIMARY KEY (survey_id, bay_id)
        ) STRICT;
        INSERT INTO hall VALUES ('hall-1', 'Nord');
        INSERT INTO bay VALUES ('bay-1', 'hall-1', 'salt');
        INSERT INTO survey VALUES ('survey-1', 'hall-1', 'abc', '/a.mcap', NULL, '0.1', 'b', '');
        INSERT INTO volume VALUES ('survey-1', 'bay-1', 0, 1.5, 0.5, NULL, NULL, '{}');
        PRAGMA user_version = 1;";

    #[test]
    fn books_of_the_first_program_keep_all_they_hold() {
        let mut database = Connection::open_in_memory().unwrap();
        database.execute_batch(OLD).unwrap();
        bring_up(&mut database).unwrap();
        bring_up(&mut database).unwrap();
        let text = |sql: &str| database.query_row(sql, [], |row| row.get::<_, String>(0)).unwrap();
        let joined = "SELECT survey.id || ' ' || COALESCE(number, 'unknown') || ' ' || independent || ' ' || volume_m3
            FROM volume JOIN survey ON survey.id = survey_id JOIN hall ON hall.id = hall_id";
        // Which survey of its log it was, nobody wrote down.
        assert_eq!(text(joined), "survey-1 unknown  1.5");
        assert_eq!(text("PRAGMA integrity_check"), "ok");
        let broken = database.prepare("PRAGMA foreign_key_check").unwrap().exists([]).unwrap();
        assert!(!broken);
        // The references hold as before.
        let stray = "INSERT INTO volume VALUES ('none', 'bay-1', 0, 1, 1, NULL, NULL, '{}')";
        assert!(database.execute(stray, []).is_err());
        // Another survey of the same log has a place, the same one has not.
        let add = |number: i64| {
            let sql = "INSERT INTO survey VALUES
                ('survey-1-' || ?1, 'hall-1', NULL, 'abc', ?1, '/a.mcap', NULL, NULL, '0.1', 'b', '', '', NULL)";
            database.execute(sql, [number])
        };
        assert!(add(2).is_ok() && add(2).is_err());
    }

    #[test]
    fn books_of_the_second_program_keep_all_they_hold() {
        let mut database = Connection::open_in_memory().unwrap();
        database.execute_batch(OLD).unwrap();
        // As the second program brought them up, and added to them.
        database
            .execute_batch(
                "PRAGMA foreign_keys = OFF;
                 PRAGMA legacy_alter_table = ON;
                 ALTER TABLE survey RENAME TO survey_1;
                 CREATE TABLE survey (id TEXT PRIMARY KEY, hall_id TEXT NOT NULL REFERENCES hall(id),
                     log_sha256 TEXT NOT NULL, number INTEGER NOT NULL, log_path TEXT NOT NULL,
                     started_utc TEXT, version TEXT NOT NULL, build TEXT NOT NULL, config_toml TEXT NOT NULL,
                     independent TEXT NOT NULL, UNIQUE (log_sha256, number)) STRICT;
                 INSERT INTO survey SELECT id, hall_id, log_sha256, 1, log_path, started_utc, version, build,
                     config_toml, '' FROM survey_1;
                 DROP TABLE survey_1;
                 INSERT INTO survey VALUES
                     ('survey-1-2', 'hall-1', 'abc', 2, '/a.mcap', 'T', '0.1', 'b', '', 'base');
                 PRAGMA user_version = 2;",
            )
            .unwrap();
        bring_up(&mut database).unwrap();
        let mut query = database
            .prepare("SELECT id, number, started_utc, independent FROM survey ORDER BY id")
            .unwrap();
        let rows = query
            .query_map([], |row| Ok((row.get(0)?, row.get(1)?, row.get(2)?, row.get(3)?)))
            .unwrap()
            .collect::<Result<Vec<(String, Option<i64>, Option<String>, String)>, _>>()
            .unwrap();
        let none = String::new();
        assert_eq!(
            rows,
            [
                ("survey-1".to_owned(), None, None, none),
                ("survey-1-2".to_owned(), Some(2), Some("T".to_owned()), "base".to_owned())
            ]
        );
    }

    #[test]
    fn books_of_the_third_program_have_room_for_decisions() {
        let mut database = Connection::open_in_memory().unwrap();
        let third = SURVEY.replace("        decision TEXT,\n", "");
        database.execute_batch(&[&third, OTHERS, REPLACED].concat()).unwrap();
        database
            .execute_batch(
                "INSERT INTO hall VALUES ('hall-1', 'Nord');
                 INSERT INTO survey VALUES ('survey-1', 'hall-1', 'i', 'abc', 2, '/a.mcap', 'T', 7, '0.1', 'b', '',
                     'base');
                 PRAGMA user_version = 3;",
            )
            .unwrap();
        bring_up(&mut database).unwrap();
        let (identity, number, decision) = database
            .query_row("SELECT identity, number, decision FROM survey", [], |row| {
                Ok((row.get(0)?, row.get(1)?, row.get(2)?))
            })
            .map(|row: (String, i64, Option<String>)| row)
            .unwrap();
        assert_eq!((identity.as_str(), number, decision), ("i", 2, None));
        // Those of its second day had it.
        database.pragma_update(None, "user_version", 3).unwrap();
        bring_up(&mut database).unwrap();
    }
}
