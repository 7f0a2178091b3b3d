// A database as colmap makes it, of the tables and columns that are used here.
#pragma once

#include <fmt/format.h>
#include <gtest/gtest.h>
#include <sqlite3.h>

#include <array>
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
        "CREATE TABLE keypoints(image_id INTEGER PRIMARY KEY, rows INTEGER, cols INTEGER,"
        " data BLOB);"
        "CREATE TABLE matches(pair_id INTEGER PRIMARY KEY, rows INTEGER, cols INTEGER, data BLOB);"
        "CREATE TABLE two_view_geometries(pair_id INTEGER PRIMARY KEY, rows INTEGER,"
        " cols INTEGER, data BLOB)");
  }
  ~MadeDatabase() { sqlite3_close(db_); }
  MadeDatabase(const MadeDatabase&) = delete;
  MadeDatabase& operator=(const MadeDatabase&) = delete;

  // Ids are 1, 2, ...
  int64_t add_image(const std::string& name, const std::vector<uint8_t>& descriptors,
                    int64_t camera = 1) {
    const int64_t id = number("SELECT COUNT(*) FROM images") + 1;
    run(fmt::format("INSERT INTO images VALUES({}, '{}', {})", id, name, camera));
    insert("descriptors", id, kDescriptorBytes, descriptors);
    return id;
  }
  // x, y, size and turn of each.
  void add_keypoints(int64_t image, const std::vector<std::array<float, 4>>& keypoints) {
    insert("keypoints", image, 4, keypoints);
  }
  // image_a < image_b; the feature of the one and of the other.
  void add_verified(int64_t image_a, int64_t image_b,
                    const std::vector<std::array<uint32_t, 2>>& matches) {
    insert("two_view_geometries", int64_t{2147483647} * image_a + image_b, 2, matches);
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
  template <class T>
  void insert(const char* table, int64_t id, size_t columns, const std::vector<T>& values) {
    const size_t row = sizeof(T) == 1 ? columns : 1;  // values to a row of the table
    sqlite3_stmt* statement = nullptr;
    const std::string sql = fmt::format("INSERT INTO {} VALUES(?, ?, {}, ?)", table, columns);
    EXPECT_EQ(sqlite3_prepare_v2(db_, sql.c_str(), -1, &statement, nullptr), SQLITE_OK);
    sqlite3_bind_int64(statement, 1, id);
    sqlite3_bind_int64(statement, 2, static_cast<int64_t>(values.size() / row));
    const void* data = values.empty() ? static_cast<const void*>("") : values.data();
    sqlite3_bind_blob64(statement, 3, data, values.size() * sizeof(T), SQLITE_TRANSIENT);
    EXPECT_EQ(sqlite3_step(statement), SQLITE_DONE);
    sqlite3_finalize(statement);
  }

  sqlite3* db_ = nullptr;
};

}  // namespace nerf::test
