// Records that kernels return: tuples whose items have names.
#pragma once

#include <nanobind/nanobind.h>

#include <initializer_list>
#include <vector>

namespace contid {

class Record {
 public:
  // Literals: the type keeps the pointers.
  Record(const char* name, std::initializer_list<const char*> fields) {
    for (const char* field : fields) fields_.push_back({field, nullptr});
    fields_.push_back({nullptr, nullptr});
    PyStructSequence_Desc described{name, nullptr, fields_.data(), static_cast<int>(fields.size())};
    type_ = PyStructSequence_NewType(&described);
    if (!type_) throw nanobind::python_error();
  }

  // One value per field, in their order.
  template <class... Values> nanobind::object operator()(Values&&... values) const {
    nanobind::object record = nanobind::steal(PyStructSequence_New(type_));
    if (!record.is_valid()) throw nanobind::python_error();
    Py_ssize_t field = 0;
    (PyStructSequence_SetItem(record.ptr(), field++, nanobind::cast(std::forward<Values>(values)).release().ptr()),
     ...);
    return record;
  }

 private:
  std::vector<PyStructSequence_Field> fields_;
  PyTypeObject* type_ = nullptr;
};

}  // namespace contid
