/* The release of plclink as text. It knows nothing of what is released. */
#ifndef INC_plcVersion_H
#define INC_plcVersion_H

#ifdef __cplusplus
extern "C" {
#endif

/* "1.0.0"; a constant, from any thread. Also in drvS7plc.h. */
const char *s7plcVersion(void);

#ifdef __cplusplus
}
#endif

#endif /* INC_plcVersion_H */
