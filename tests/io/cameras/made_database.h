// A database as colmap makes it, of the tables and columns that are used here.
#pragma once

#include <fmt/format.h>
#include <gtest/gtest.h>
#include <sqlite3.h>

#include <cstdint>
#include <filesystem>
#include <fstream>
#include <string>
#include <vector>

#include "nerf/kernels/descriptors.h"

namespace nerf::test {

class MadeDatabase {
 public:
  explicit MadeDatabase(const std::filesystem::path& file) {
    EXPECT_EQ(sqlite3_open(file.c_str(), &db_), SQLITE_OK);
    run("CREATE TABLE images(image_id INTEGER PRIMARY KEY, name TEXT, camera_id INTEGER);"
        "CREATE TABLE descriptors(image_id INTEGER PRIMARY KEY, rows INTEGER, cols INTEGER,"
        " data BLOB);"
        "CREATE TABLE matches(pair_id INTEGER PRIMARY KEY, rows INTEGER, cols INTEGER, data BLOB)");
  }
  ~MadeDatabase() { sqlite3_close(db_); }
  MadeDatabase(const MadeDatabase&) = delete;
  MadeDatabase& operator=(const MadeDatabase&) = delete;

  // Ids are 1, 2, ...
  int64_t add_image(const std::string& name, const std::vector<uint8_t>& descriptors,
                    int64_t camera = 1) {
    const int64_t id = number("SELECT COUNT(*) FROM images") + 1;
    run(fmt::format("INSERT INTO images VALUES({}, '{}', {})", id, name, camera));
    sqlite3_stmt* statement = nullptr;
    EXPECT_EQ(sqlite3_prepare_v2(db_, "INSERT INTO descriptors VALUES(?, ?, 128, ?)", -1,
                                 &statement, nullptr),
              SQLITE_OK);
    sqlite3_bind_int64(statement, 1, id);
    sqlite3_bind_int64(statement, 2, static_cast<int64_t>(descriptors.size()) / kDescriptorBytes);
    const void* data = descriptors.empty() ? static_cast<const void*>("") : descriptors.data();
    sqlite3_bind_blob64(statement, 3, data, descriptors.size(), SQLITE_TRANSIENT);
    EXPECT_EQ(sqlite3_step(statement), SQLITE_DONE);
    sqlite3_finalize(statement);
    return id;
  }
  void run(const std::string& sql) {
    EXPECT_EQ(sqlite3_exec(db_, sql.c_str(), nullptr, nullptr, nullptr), SQLITE_OK)
        << sqlite3_errmsg(db_);
  }
  int64_t number(const std::string& sql) {
    sqlite3_stmt* statement = nullptr;
    EXPECT_EQ(sqlite3_prepare_v2(db_, sql.c_str(), -1, &statement, nullptr), SQLITE_OK);
    EXPECT_EQ(sqlite3_step(statement), SQLITE_ROW) << sql;
    const int64_t value = sqlite3_column_int64(statement, 0);
    sqlite3_finalize(statement);
    return value;
  }

 private:
  sqlite3* db_ = nullptr;
};

}  // namespace nerf::test
