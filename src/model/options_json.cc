#include "nerf/model/options_json.h"

#include <algorithm>
#include <nlohmann/json.hpp>
#include <set>

#include "nerf/base/nearest_name.h"
#include "nerf/base/text.h"

namespace nerf {
namespace {

using Json = nlohmann::ordered_json;

Json to_json(const std::optional<OptionValue>& value) {
  if (!value) return nullptr;
  return std::visit([](const auto& x) { return Json(x); }, *value);
}

// Parses, and refuses a key that stands twice in one object (the library would keep the last one
// without a word).
Json parse(const std::string& text, const std::string& where) {
  std::vector<std::set<std::string>> keys;
  const auto watch = [&](int, Json::parse_event_t event, Json& parsed) {
    if (event == Json::parse_event_t::object_start) {
      keys.emplace_back();
    } else if (event == Json::parse_event_t::object_end) {
      keys.pop_back();
    } else if (event == Json::parse_event_t::key) {
      if (!keys.back().insert(parsed.get<std::string>()).second)
        throw Error("key \"" + parsed.get<std::string>() + "\" is given twice", where,
                    "remove one of the two");
    }
    return true;
  };
  try {
    return Json::parse(text, watch);
  } catch (const Json::parse_error& error) {
    // The library counts bytes from 1, and points behind the offending one.
    const size_t byte = error.byte > 0 ? error.byte - 1 : 0;
    throw Error("not valid JSON", where + ":" + line_and_column(text, byte),
                "correct the text at this line and column");
  } catch (const Json::out_of_range&) {
    throw Error("holds a number that is out of range", where);
  }
}

std::string type_name(const Json& value) {
  return value.is_object() ? "an object" : value.is_array() ? "an array" : value.type_name();
}

OptionValue from_json(const Json& value, const OptionField& field, const std::string& where) {
  const auto refuse = [&] {
    throw Error("expected " + option_domain(field) + ", found " + type_name(value), where);
  };
  if (value.is_boolean()) return value.get<bool>();
  if (value.is_number_unsigned()) {
    // Small numbers as signed ones: both kinds of integer fields take them.
    const auto x = value.get<uint64_t>();
    if (x <= uint64_t{INT64_MAX}) return static_cast<int64_t>(x);
    return x;
  }
  if (value.is_number_integer()) return value.get<int64_t>();
  if (value.is_number_float()) return value.get<double>();
  if (value.is_string()) return value.get<std::string>();
  if (!value.is_array()) refuse();
  std::vector<double> numbers;
  for (const Json& item : value) {
    if (!item.is_number()) refuse();
    numbers.push_back(item.get<double>());
  }
  return numbers;
}

class Reader {
 public:
  Reader(const std::vector<OptionField>& fields, const std::vector<RetiredOption>& retired,
         const std::string& where)
      : fields_(fields), retired_(retired), where_(where) {}

  void read(const Json& object, const std::string& prefix) const {
    for (const auto& [key, value] : object.items()) {
      const std::string name = prefix + key;
      const std::string place = where_ + ": " + name;
      if (is_group(name)) {
        if (!value.is_object()) throw Error("expected an object, found " + type_name(value), place);
        read(value, name + ".");
      } else if (!is_retired(name, value, place)) {
        const OptionField& field = find(name, prefix, place);
        if (value.is_null())
          set_option(field, std::nullopt, place);
        else
          set_option(field, from_json(value, field, place), place);
      }
    }
  }

 private:
  bool is_retired(const std::string& name, const Json& value, const std::string& place) const {
    const auto found = std::ranges::find(retired_, name, &RetiredOption::name);
    if (found == retired_.end()) return false;
    if (value != to_json(found->harmless))
      throw Error("this option is no more", place,
                  "train anew without it, or keep to the version that wrote the file");
    return true;
  }

  bool is_group(const std::string& name) const {
    return std::any_of(fields_.begin(), fields_.end(), [&](const OptionField& f) {
      return f.name.size() > name.size() && f.name.starts_with(name) && f.name[name.size()] == '.';
    });
  }

  // Groups and fields of this object, as their keys.
  std::vector<std::string> keys_below(const std::string& prefix) const {
    std::vector<std::string> keys;
    for (const OptionField& f : fields_) {
      if (!f.name.starts_with(prefix)) continue;
      std::string key = f.name.substr(prefix.size());
      key = key.substr(0, key.find('.'));
      if (keys.empty() || keys.back() != key) keys.push_back(std::move(key));
    }
    return keys;
  }

  const OptionField& find(const std::string& name, const std::string& prefix,
                          const std::string& place) const {
    for (const OptionField& f : fields_)
      if (f.name == name) return f;
    throw Error("unknown option", place,
                nearest_name_hint(name.substr(prefix.size()), keys_below(prefix)));
  }

  const std::vector<OptionField>& fields_;
  const std::vector<RetiredOption>& retired_;
  const std::string& where_;
};

}  // namespace

std::string fields_to_json(const std::vector<OptionField>& fields) {
  Json root = Json::object();
  for (const OptionField& field : fields) {
    Json* object = &root;
    size_t start = 0;
    for (size_t dot; (dot = field.name.find('.', start)) != std::string::npos; start = dot + 1)
      object = &(*object)[field.name.substr(start, dot - start)];
    (*object)[field.name.substr(start)] = to_json(field.get());
  }
  return root.dump(2, ' ', false, Json::error_handler_t::replace) + "\n";
}

void fields_from_json(const std::vector<OptionField>& fields,
                      const std::vector<RetiredOption>& retired, const std::string& json,
                      const std::string& where) {
  const Json root = parse(json, where);
  if (!root.is_object())
    throw Error("expected an object of options, found " + type_name(root), where);
  Reader(fields, retired, where).read(root, "");
}

}  // namespace nerf
