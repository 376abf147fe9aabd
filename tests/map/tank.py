"""The worked example: a tank with setpoints, measurements, two valves and a clock."""
MAP = """\
symbol,plc,type,dir,tx,rx,via,pv,desc,egu,prec,lopr,hopr,lolo,low,high,hihi,sev,states,raw,eng,archive,autosave,asg,group,fields,note
Tank.TempSP,DB10.DBD0,REAL,out,4,4,ptr,TempSP,temperature setpoint,C,1,0,90,,,,,,,,,1,yes,,Tank,,
Tank.SpeedSP,DB10.DBW4,INT,out,8,8,ptr,SpeedSP,speed setpoint,rpm,,0,3000,,,,,,,,,,yes,,Tank,,
Tank.Pump,DB10.DBX6.0,BOOL,out,10.0,10.0,ptr,Pump,pump,,,,,,,,,,off|on,,,,,,Tank,,
Tank.Heater,DB10.DBX6.1,BOOL,out,10.1,10.1,ptr,Heater,heater,,,,,,,,,,off|on,,,,,,Tank,,
Tank.Mode,DB10.DBW8,INT,out,12,12,ptr,Mode,mode,,,,,,,,,,@MODE,,,,,,Tank,,
Tank.Recipe,DB10.DBB10,STRING[16],out,14,14,ptr,Recipe,name of the recipe,,,,,,,,,,,,,,,,Tank,,
Tank.Ramp,DB10.DBD28,ARRAY[1..4] OF REAL,out,32,32,ptr,Ramp,ramp,C/min,2,,,,,,,,,,,,,,Tank,,
Tank.Valve,DB10.DBW44,INT,out,48,48,ptr,ValveSP,valve position,%,1,0,100,,,,,,,0..27648,0..100,,,,Tank,,
Tank.Total,DB10.DBD46,DINT,out,50,50,ptr,TotalSP,batch,kg,,,,,,,,,,,,,,,Tank,,
Tank.Temp,DB11.DBD0,REAL,in,54,,explicit,Temp,temperature,C,1,0,120,5,10,80,95,,,,,1,,,Tank,,
Tank.Level,DB11.DBW4,INT,in,58,,explicit,Level,level,%,1,0,100,,5,95,,,,0..27648,0..100,1,,,Tank,,
Tank.Count,DB11.DBD6,UDINT,in,60,,explicit,Count,pieces,,,,,,,,,,,,,,,,Tank,,
Tank.Flags,DB11.DBW10,WORD,in,64,,explicit,Flags,raw status,,,,,,,,,,,,,,,,Tank,,
Tank.Name,DB11.DBB12,STRING[20],in,66,,ptr,Name,batch name,,,,,,,,,,,,,,,,Tank,,
Tank.Profile,DB11.DBW34,ARRAY[0..4] OF INT,in,88,,ptr,Profile,level profile,mm,,,,,,,,,,,,,,,Tank,,
Tank.Door,M4.3,BOOL,in,98.0,,explicit,Door,door,,,,,,,,,,closed|OPEN!MAJOR,,,,,,Tank,,
V101,DB12.DBB0,VALVE,in,100,,ptr,V101:,inlet valve,,,,,,,,,,,,,,,,Valves,,
V102,DB12.DBB8,VALVE,in,108,,ptr,V102:,outlet valve,,,,,,,,,,,,,,,,Valves,,
Clock,DB13.DBB0,DATE_AND_TIME,in,116,,ptr,Time,clock of the PLC,,,,,,,,,,,,,,,,,,
"""
PLC = """\
key,value
name,TANK
sync,on
readback,0
prefix,tank:
"""
TYPES = """\
type,field,ftype,at,suffix,dir,desc,egu,states
VALVE,Open,BOOL,,,,open,,
,Closed,BOOL,,,,closed,,
,Fault,BOOL,,,,fault,,ok|FAULT!MAJOR
,Cycles,INT,,,,cycles,,
,Pos,REAL,,,,position,%,
"""
ENUMS = """\
enum,value,text,sev
MODE,0,stop,
,1,manual,
,2,auto,
,7,service,MINOR
"""


def write(folder, **changes):
    """A folder with the example; changes: map=, plc=, types=, enums= in place of its sheets."""
    folder.mkdir(parents=True, exist_ok=True)
    for name, text in (("map", MAP), ("plc", PLC), ("types", TYPES), ("enums", ENUMS)):
        (folder / (name + ".csv")).write_text(changes.get(name, text), encoding="utf-8")
    return folder
